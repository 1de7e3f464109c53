"""Images that a notebook shows for a frame or a result; a later package draws them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

# The module that draws; the package `cuboid` sets it, because a stage must not import a later one.
_drawn_by = ""


def draw_with(module: str) -> None:
    """Set the module whose `frame_png` and `result_png` draw the images."""
    global _drawn_by
    _drawn_by = module


def png_of(name: str, value: object) -> bytes:
    """Return the PNG that the function `name` of the drawing module makes from a value."""
    drawn: Any = getattr(import_module(_drawn_by), name)
    png: bytes = drawn(value)
    return png
