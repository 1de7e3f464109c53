"""Pictures that a notebook shows of a frame or a result; a later package draws them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

# The module that draws; `cuboid` names it, since a stage imports no later one.
_drawn_by = ""


def draw_with(module: str) -> None:
    """Name the module whose `frame_png` and `result_png` draw the pictures."""
    global _drawn_by
    _drawn_by = module


def png_of(name: str, value: object) -> bytes:
    """Return the PNG that the function `name` of that module draws of a value."""
    drawn: Any = getattr(import_module(_drawn_by), name)
    png: bytes = drawn(value)
    return png
