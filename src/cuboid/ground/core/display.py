"""Images that a notebook shows for a frame or a result; the package `cuboid` gives the function that draws them."""

from __future__ import annotations

from collections.abc import Callable

Draw = Callable[[object], bytes]
_draw: Draw | None = None


def draw_with(draw: Draw) -> None:
    """Set the function that returns the PNG of a frame or a result."""
    global _draw
    _draw = draw


def png_of(value: object) -> bytes:
    """Return the PNG of a frame or a result."""
    assert _draw is not None
    return _draw(value)
