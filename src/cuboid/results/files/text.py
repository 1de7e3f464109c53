"""The text of numbers: a fixed number of digits, so that equal results are equal bytes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, SupportsFloat

import numpy as np

from cuboid.ground.core.records import DIRECTION as DIRECTION
from cuboid.ground.core.records import LENGTH as LENGTH
from cuboid.ground.core.records import PIXEL as PIXEL

# Digits after the point of centimetres: a hundredth of a millimetre.
CENTIMETRE = 3


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


def plain(value: Any) -> Any:
    """Return a value ready for JSON: lists for tuples and arrays, floats with `LENGTH` decimals."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return rounded(value, LENGTH) if isinstance(value, float) else value
