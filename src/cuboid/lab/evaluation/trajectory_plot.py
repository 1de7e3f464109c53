"""A plot of two camera paths, from above, and of their distance over time, as PNG or SVG."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.lab.evaluation.trajectory import TrajectoryErrors
from cuboid.results.files.pending import write_whole

ENDINGS = (".png", ".svg")
TRUE_COLOR, ESTIMATE_COLOR = "#787e88", "#d64526"
# A path is interrupted where a time step exceeds the median step by this factor: poses without a pair lie there.
GAP_FACTOR = 3


def refuse_other_forms(path: Path) -> None:
    """Refuse a plot that cannot be written, before any computation.

    Raises
    ------
    InputError
        The name does not end in ``.png`` or ``.svg``.
    MissingExtraError
        Matplotlib is not installed.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a plot is written as {' or '.join(ENDINGS)}, not as '{path.suffix}'")
    require("matplotlib", "--plot", "plot")


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
        The name has another suffix.
    MissingExtraError
        Matplotlib is not installed.
    OutputError
        The file cannot be written.
    """
    refuse_other_forms(path)
    matplotlib, made = require("matplotlib", "--plot", "plot"), BytesIO()
    figure = require("matplotlib.figure", "--plot", "plot").Figure(figsize=(12, 5.6), layout="constrained")
    paths, error = figure.subplots(1, 2)
    _draw_paths(paths, found)
    _draw_error(error, found)
    # The same paths give the same bytes.
    with matplotlib.rc_context({"svg.hashsalt": "cuboid"}):
        form = path.suffix.lower().removeprefix(".")
        figure.savefig(made, format=form, metadata={"Date": None} if form == "svg" else {})
    write_whole(path, made.getvalue())


def _draw_paths(axes: Any, found: TrajectoryErrors) -> None:
    true, estimate = flattened(found.true_xyz, found.estimated_xyz)
    axes.plot(*true.T, color=TRUE_COLOR, linewidth=3, label="truth")
    axes.plot(*estimate.T, color=ESTIMATE_COLOR, linewidth=1, label="estimate")
    axes.set_title("both paths along their largest extents, m")
    axes.axis("equal")
    axes.grid()
    axes.legend()


def _draw_error(axes: Any, found: TrajectoryErrors) -> None:
    times_s = found.times_s - found.times_s[0]
    steps = np.diff(times_s)
    gaps = np.flatnonzero(steps > GAP_FACTOR * np.median(steps)) + 1
    axes.plot(np.insert(times_s, gaps, np.nan), np.insert(100.0 * found.error_m, gaps, np.nan), color=ESTIMATE_COLOR)
    axes.set_title(f"distance in cm over time in s; RMSE {found.ate_cm.rmse:.2f} cm")
    axes.set_ylim(bottom=0.0)
    axes.grid()


def flattened(true_xyz: Float64Array, estimated_xyz: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return both paths (N, 2) along the two directions in which the true one (N, 3) extends most.

    For a camera that circles a table this is the view from above or below. The sign of each direction makes its largest
    component in the world positive.
    """
    middle = true_xyz.mean(0)
    axes = np.linalg.svd(true_xyz - middle, full_matrices=True)[2][:2]
    axes = axes * np.sign(axes[np.arange(2), np.abs(axes).argmax(1)])[:, None]
    return (true_xyz - middle) @ axes.T, (estimated_xyz - middle) @ axes.T
