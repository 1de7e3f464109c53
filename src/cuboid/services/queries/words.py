"""Words of a query: lengths, positions, times, objects; an invalid word raises a ValueError of one line."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from math import inf, isfinite

UNITS_M = {"mm": 0.001, "cm": 0.01, "m": 1.0}
_LENGTH = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*(mm|cm|m|)")
_AGO = re.compile(r"(\d+(?:\.\d*)?)\s*(min|h|d|w)")
_AGO_S = {"min": 60.0, "h": 3600.0, "d": 86400.0, "w": 604800.0}


def length(text: str) -> float:
    """Parse a length with its unit; return metres."""
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"expected a length such as 14cm, 80mm or 0.5m, got '{text}'")
    if not found[2] and float(found[1]):
        raise ValueError(f"{text.strip()} what? A length needs its unit: {text.strip()}cm, or {text.strip()}m")
    return float(found[1]) * UNITS_M.get(found[2], 1.0)


def whole(text: str) -> int:
    """Parse a whole number from 0."""
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise ValueError(f"expected a whole number from 0, got '{text}'")
    return int(text)


def count(text: str) -> int:
    """Parse a whole number from 1."""
    if not whole(text):
        raise ValueError(f"expected a whole number from 1, got '{text}'")
    return int(text)


def sizes(text: str) -> tuple[float, float]:
    """Parse a range of lengths; either end may be omitted, and the unit of the second holds for a first without one."""
    low, dots, high = text.partition("..")
    if not dots or not (low or high):
        raise ValueError(f"expected A..B such as 8..14cm, 0.5m.. or ..20cm, got '{text}'")
    if not re.search(r"[a-z]", text):
        raise ValueError(f"{text.strip()} what? A length needs its unit: {text.strip()}cm, or {text.strip()}m")
    unit = re.sub(r"[\d. ]", "", high)
    if low and not re.search(r"[a-z]", low):
        low += unit
    found = (length(low) if low else 0.0, length(high) if high else inf)
    if found[0] > found[1]:
        raise ValueError(f"expected A..B with A at most B, got '{text}'")
    return found


def place(text: str) -> tuple[float, float, float]:
    """Parse X,Y,Z in metres."""
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        x = y = z = inf
    if not all(map(isfinite, (x, y, z))):
        raise ValueError(f"expected X,Y,Z in metres, got '{text}'")
    return x, y, z


def moment(text: str) -> datetime:
    """Parse a date, a time, or a duration before now."""
    try:
        if ago := _AGO.fullmatch(text.strip()):
            return datetime.now(UTC) - timedelta(seconds=float(ago[1]) * _AGO_S[ago[2]])
        found = datetime.fromisoformat(text)
        return found.astimezone(UTC) if found.tzinfo else found.replace(tzinfo=UTC)
    except (ValueError, OverflowError):  # no date, or a year out of range
        raise ValueError(f"expected 2026-03-01, 2026-03-01T12:00, or 7d, 12h, 30min, got '{text}'") from None


def thing(text: str) -> tuple[str, int]:
    """Parse RECORDING#LABEL."""
    name, sign, label = text.rpartition("#")
    if not (sign and name and label.isascii() and label.isdecimal()):
        raise ValueError(f"expected RECORDING#LABEL such as kitchen-3#7, got '{text}'")
    return name, int(label)
