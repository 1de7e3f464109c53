"""Markdown tables and JSON: how every benchmark shows its figures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any


def cell(value: Any, digits: int = 3) -> str:
    """Return a figure as text: "-" where it is undefined."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.{digits}f}"
    return str(value)


def markdown(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table; numbers that need other digits than three come as text."""
    lines = [header, ["---"] * len(header), *([cell(value) for value in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def show(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Print a table under a line that says what it is."""
    print(f"\n{title}\n\n{markdown(header, rows)}", flush=True)


def dump(value: Any) -> None:
    """Print as JSON."""
    print(json.dumps(value, indent=1, allow_nan=False))
