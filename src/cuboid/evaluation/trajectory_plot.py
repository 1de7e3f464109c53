"""A picture of two camera paths: both from above, and how far they are apart over time; as PNG or SVG."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from cuboid.core.errors import InputError
from cuboid.core.frame import Float64Array
from cuboid.evaluation.trajectory import TrajectoryErrors
from cuboid.outputs.pending import write_whole
from cuboid.views.text import Color, ink, put_text

WIDTH_PX, HEIGHT_PX = 1200, 560
TEXT_PX = 15
WHITE, INK, FAINT = (255, 255, 255), (40, 44, 52), (222, 225, 230)
TRUE_COLOR, ESTIMATE_COLOR = (120, 126, 136), (214, 69, 38)
# This many lines of a grid at most, and the steps that people count in.
GRID_LINES = 6
STEPS = (1.0, 2.0, 5.0, 10.0)
SHIFT = 4  # cv2 draws to a sixteenth of a pixel


class Canvas(Protocol):
    """The drawing area."""

    def line(self, xy: Float64Array, color: Color, width_px: int) -> None:
        """Draw a line through points (N, 2), pixels."""

    def text(self, text: str, x: float, y: float, color: Color, *, middle: bool = False) -> None:
        """Write a line of text whose left end, or middle, is at x and whose top is at y."""

    def content(self) -> bytes:
        """Return the picture's file."""


class PngCanvas:
    """Pixels."""

    def __init__(self) -> None:
        self._picture = np.full((HEIGHT_PX, WIDTH_PX, 3), WHITE, np.uint8)

    def line(self, xy: Float64Array, color: Color, width_px: int) -> None:
        """Draw a line through points (N, 2), pixels."""
        points = np.round(xy * (1 << SHIFT)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(self._picture, [points], False, color, width_px, cv2.LINE_AA, SHIFT)

    def text(self, text: str, x: float, y: float, color: Color, *, middle: bool = False) -> None:
        """Write a line of text whose left end, or middle, is at x and whose top is at y."""
        left = x - ink(text, TEXT_PX).shape[1] / 2 if middle else x
        put_text(self._picture, text, round(left), round(y), TEXT_PX, color)

    def content(self) -> bytes:
        """Return the picture's file."""
        return cv2.imencode(".png", self._picture[..., ::-1])[1].tobytes()


class SvgCanvas:
    """Lines that stay sharp."""

    def __init__(self) -> None:
        self._parts: list[str] = []

    def line(self, xy: Float64Array, color: Color, width_px: int) -> None:
        """Draw a line through points (N, 2), pixels."""
        points = " ".join(f"{x:.2f},{y:.2f}" for x, y in xy)
        self._parts.append(
            f'<polyline points="{points}" fill="none" stroke="rgb{color}" stroke-width="{width_px}" '
            'stroke-linejoin="round"/>'
        )

    def text(self, text: str, x: float, y: float, color: Color, *, middle: bool = False) -> None:
        """Write a line of text whose left end, or middle, is at x and whose top is at y."""
        anchor = "middle" if middle else "start"
        self._parts.append(
            f'<text x="{x:.2f}" y="{y + 0.95 * TEXT_PX:.2f}" fill="rgb{color}" text-anchor="{anchor}">'
            f"{escape(text)}</text>"
        )

    def content(self) -> bytes:
        """Return the picture's file."""
        body = "\n".join(self._parts)
        text = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" '
            f'font-family="sans-serif" font-size="{TEXT_PX}">\n<rect width="100%" height="100%" fill="white"/>\n'
            f"{body}\n</svg>\n"
        )
        return text.encode("utf-8")


CANVASES: dict[str, type[PngCanvas] | type[SvgCanvas]] = {".png": PngCanvas, ".svg": SvgCanvas}


@dataclass(frozen=True, slots=True)
class Panel:
    """A rectangle of the picture with axes of its own; y grows upward.

    Attributes
    ----------
    x_px, y_px, width_px, height_px : float
    low, high : (2,) float64
        Values at the left lower and the right upper corner.
    """

    x_px: float
    y_px: float
    width_px: float
    height_px: float
    low: Float64Array
    high: Float64Array

    def place(self, xy: Float64Array) -> Float64Array:
        """Return values (N, 2) as pixels."""
        fraction = (xy - self.low) / (self.high - self.low)
        return np.stack(
            [self.x_px + fraction[:, 0] * self.width_px, self.y_px + (1.0 - fraction[:, 1]) * self.height_px], axis=1
        )

    def draw_grid(self, canvas: Canvas, title: str) -> None:
        """Draw title, lines and their values."""
        canvas.text(title, self.x_px, self.y_px - 1.8 * TEXT_PX, INK)
        for axis in (0, 1):
            for value in ticks(float(self.low[axis]), float(self.high[axis])):
                ends = np.array([self.low, self.high])
                ends[:, axis] = value
                line = self.place(ends)
                canvas.line(line, FAINT, 1)
                if axis == 0:
                    canvas.text(f"{value:g}", line[0, 0], self.y_px + self.height_px + 6, INK, middle=True)
                else:
                    canvas.text(f"{value:g}", self.x_px - 26, line[0, 1] - 0.6 * TEXT_PX, INK, middle=True)


def plot(found: TrajectoryErrors, path: Path) -> None:
    """Write a picture of the two paths and of their distance over time.

    Parameters
    ----------
    found : TrajectoryErrors
    path : Path
        Ends in ``.png`` or ``.svg``.

    Raises
    ------
    InputError
        The name has another end.
    OutputError
        The file cannot be written.
    """
    canvas = canvas_of(path)
    _draw_paths(canvas, found)
    _draw_error(canvas, found)
    write_whole(path, canvas.content())


def canvas_of(path: Path) -> Canvas:
    """Return an empty picture of the form that the file's name asks for; InputError for another form."""
    make = CANVASES.get(path.suffix.lower())
    if make is None:
        raise InputError(f"{path}: a plot is written as {' or '.join(CANVASES)}, not as '{path.suffix}'")
    return make()


def _draw_paths(canvas: Canvas, found: TrajectoryErrors) -> None:
    true, estimate = flattened(found.true_xyz, found.estimated_xyz)
    low, high = _limits(np.concatenate([true, estimate]))
    side = max(float((high - low).max()), 1e-3)
    middle = (low + high) / 2
    panel = Panel(70, 60, 450, 450, middle - side / 2, middle + side / 2)
    panel.draw_grid(canvas, "both paths along their largest extents, m")
    canvas.line(panel.place(true), TRUE_COLOR, 3)
    canvas.line(panel.place(estimate), ESTIMATE_COLOR, 1)
    canvas.text("truth", 380, 64, TRUE_COLOR)
    canvas.text("estimate", 440, 64, ESTIMATE_COLOR)


def _draw_error(canvas: Canvas, found: TrajectoryErrors) -> None:
    times_s = found.times_s - found.times_s[0]
    error_cm = 100.0 * found.error_m
    high = np.array([max(float(times_s[-1]), 1e-3), max(1.1 * float(error_cm.max()), 1e-3)])
    panel = Panel(610, 60, 560, 450, np.zeros(2), high)
    panel.draw_grid(canvas, f"distance in cm over time in s; RMSE {found.ate_cm.rmse:.2f} cm")
    # a gap is left open: 3 usual intervals without a pair
    steps = np.diff(times_s)
    breaks = np.flatnonzero(steps > 3 * np.median(steps)) + 1
    for part in np.split(np.stack([times_s, error_cm], axis=1), breaks):
        canvas.line(panel.place(part), ESTIMATE_COLOR, 2)


def flattened(true_xyz: Float64Array, estimated_xyz: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return both paths (N, 2) along the two directions in which the true one (N, 3) extends most.

    For a camera that goes round a table this is the view from above, or from below; each direction is turned so that
    its largest component in the world is positive.
    """
    middle = true_xyz.mean(0)
    axes = np.linalg.svd(true_xyz - middle, full_matrices=True)[2][:2]
    axes = axes * np.sign(axes[np.arange(2), np.abs(axes).argmax(1)])[:, None]
    return (true_xyz - middle) @ axes.T, (estimated_xyz - middle) @ axes.T


def ticks(low: float, high: float) -> list[float]:
    """Return round values between two limits, at most `GRID_LINES` and one."""
    span = high - low
    unit = 10.0 ** np.floor(np.log10(span / GRID_LINES))
    step = next(unit * s for s in STEPS if unit * s * GRID_LINES >= span * (1 - 1e-9))
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return [round(k * step, 9) + 0.0 for k in range(first, last + 1)]


def _limits(xy: Float64Array) -> tuple[Float64Array, Float64Array]:
    low, high = xy.min(0), xy.max(0)
    margin = 0.05 * max(float((high - low).max()), 1e-3)
    return low - margin, high + margin
