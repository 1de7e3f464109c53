"""How numbers are written: fixed, so that the same results are the same bytes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import SupportsFloat

from cuboid.core.records import DIRECTION as DIRECTION
from cuboid.core.records import LENGTH as LENGTH
from cuboid.core.records import PIXEL as PIXEL


def number(value: SupportsFloat, digits: int) -> str:
    """Return `value` with a fixed number of digits after the point, and never as a negative zero."""
    return f"{float(value):z.{digits}f}"


def numbers(values: Iterable[SupportsFloat], digits: int, separator: str = ",") -> str:
    """Return all values like `number`, joined by `separator`."""
    return separator.join(number(value, digits) for value in values)


def rounded(value: SupportsFloat, digits: int) -> float:
    """Return the float that `number` writes, for JSON."""
    return round(float(value), digits) + 0.0


def rounded_list(values: Iterable[SupportsFloat], digits: int) -> list[float]:
    """Return all values like `rounded`."""
    return [rounded(value, digits) for value in values]
