"""Measures the misalignment of depth and color from depth edges and color edges.

Where a surface ends in front of another one, a color image usually shows an edge. If depth is not registered, depth
edges are offset from color edges by the same move in all frames: magnification, shift, and, if the two cameras are
apart, a shift that grows as depth decreases. This move is estimated and cross-validated: the move from every second
frame must hold in the others. If the camera does not move, the frames show the same edges; then the move from every
second tile of the image must hold in the other tiles, and only a shift is found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.se3 import assembled
from cuboid.inputs.calibration.calibrate import MIN_PAIRS, spread_out
from cuboid.inputs.calibration.edge_fit import (
    FINE_BLUR_PX,
    NOWHERE,
    different_views,
    fit_baseline,
    fit_move,
    gain_of,
    gather_edges,
    size_of,
    tile_of,
)
from cuboid.inputs.calibration.pairs import choose_pairs
from cuboid.inputs.calibration.solving import Problem
from cuboid.inputs.calibration.views import ScaledPinhole, build_view, factors
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.recording import Recording
from cuboid.inputs.readers.usable import usable_frames, usable_poses

# Number of examined frames.
MISALIGNMENT_FRAMES = 12
# Minimum number of frames of a run for a check.
MIN_FRAMES = 8
# Depth counts as misaligned if the offset is at least MISALIGNED_WIDTH of the image's width (4 of 640 pixels, the
# uncertainty of depth edges), if both halves of the frames give the same move (within MAX_DIFFERENCE of the offset, or
# DIFFERENCE_OF_WIDTH of the width, 3 of 640 pixels), and if the cross-validated gain in edge agreement is at least
# CLEAR_GAIN and CLEAR_ERRORS standard errors.
# Registered recordings gain up to 0.04, synthetic ones with 6 pixels offset 0.14. Stereo makes objects look larger,
# which causes apparent offsets of up to 8 of 640 pixels: there is no warning below 10.
MISALIGNED_WIDTH, WORTH_A_WARNING = 0.006, 0.0156
MAX_DIFFERENCE, DIFFERENCE_OF_WIDTH = 0.35, 0.005
CLEAR_GAIN, CLEAR_ERRORS = 0.03, 4.0
# Limits of a pair of cameras: focal lengths differ by up to this factor (the search tries 0.62 to 1.62; those of a
# RealSense differ by 1.57), and the optical centers by this fraction of the image's width (a fixed RealSense at hand
# is displaced by 22 of 640 pixels, its baseline included).
FARTHEST_FOCAL, FARTHEST_CENTER = 1.62, 0.05
# With given poses, the disagreement of the views must be lower by this fraction than without registration, and the
# difference of their depths larger by at most this fraction: that of 7-Scenes rises by 8 %, because depth is resampled;
# a center that is 12 of 320 pixels off raises it by 31 %.
CLEARLY_FITS, DEPTH_FITS = 0.05, 0.1
# Number of views that decide to which camera the named intrinsics belong, and steps to fit their poses.
VIEWS, FIT_STEPS = 24, 12
# With fewer different views, tiles of the image are compared instead of frames, and only a shift is accepted: an object
# whose shiny rim has no depth looks like a magnification.
MIN_DIFFERENT_VIEWS = 3
# Minimum number of tiles (of 24) with edges: fewer may show one object only.
MIN_TILES = 6
# Beginning of the warnings about it.
DISPLACED = "depth is displaced from color"


@dataclass(frozen=True, slots=True)
class Misregistration:
    """The misalignment of depth and color.

    Depth at pixel (u, v) and z metres belongs to `center + magnification ((u, v) - center) + shift_px`, and by
    `apart_px_m / z` more along the row; center is the middle of the image.

    Attributes
    ----------
    clear : bool
        Whether the frames clearly show a misalignment.
    off_px : float
        Size of the offset, root mean square over the image, pixels.
    magnification : float
    shift_px : (float, float)
    apart_px_m : float
        0 if it cannot be determined.
    views : int
        Number of different views that were used.
    """

    clear: bool
    off_px: float
    magnification: float
    shift_px: tuple[float, float]
    apart_px_m: float
    views: int


@dataclass(frozen=True, slots=True)
class Registration:
    """The registration of a recording's depth to its color.

    Attributes
    ----------
    found : Misregistration or None
        The misalignment of depth and color, if the frames show it.
    recording : Recording
        The recording with the depth camera and the color camera's intrinsics; unchanged if there is no clear
        misalignment, or if its registration was refused.
    refused : str or None
        Why a clear misalignment is not registered.
    """

    found: Misregistration | None
    recording: Recording
    refused: str | None = None


def find_misregistration(frames: Iterable[Frame]) -> Misregistration | None:
    """Measure the misalignment of depth and color.

    Parameters
    ----------
    frames : iterable of Frame
        About `MISALIGNMENT_FRAMES` frames from different places, which take about half a second.

    Returns
    -------
    Misregistration or None
        None if the frames have too few depth edges.
    """
    found = gather_edges(frames)
    if found is None:
        return None
    edges, factor = found
    views, width = different_views(edges), edges.strength.shape[3]
    fine, shift_only = edges.blurred(FINE_BLUR_PX), views < MIN_DIFFERENT_VIEWS
    move = fit_move(edges, fine, NOWHERE, shift_only=shift_only)
    off = size_of(edges, move - NOWHERE)
    before, after = fine.agreement_inside(np.stack([NOWHERE, move]))
    clear = bool(off > MISALIGNED_WIDTH * width and after - before > CLEAR_GAIN)
    if clear:  # computed only if it is needed
        part, even = tile_of(edges) if shift_only else (edges.image, edges.image % 2 == 0)
        halves = [(edges.chosen(half), fine.chosen(half)) for half in (even, ~even)]
        fits = [fit_move(*half, move, shift_only=shift_only) for half in halves]
        gain, error, parts = gain_of(fine, part, even, *fits)
        consistent = size_of(edges, fits[0] - fits[1]) < max(MAX_DIFFERENCE * off, DIFFERENCE_OF_WIDTH * width)
        spread = parts >= MIN_TILES or not shift_only
        clear = consistent and spread and gain > max(CLEAR_GAIN, CLEAR_ERRORS * error)
    g, du, dv, p, _ = fit_baseline(fine, move).tolist()
    return Misregistration(clear, factor * off, g, (factor * du, factor * dv), factor * p, views)


def misregistration_of(read: Callable[[int], Frame], frames: Sequence[int]) -> Misregistration | None:
    """Find the misalignment from some frames, evenly over all; see `find_misregistration`."""
    chosen = np.linspace(0, len(frames) - 1, min(MISALIGNMENT_FRAMES, len(frames))).round().astype(int)
    return find_misregistration(usable_frames(read, [frames[k] for k in chosen.tolist()]))


def register_recording(recording: Recording) -> Registration:
    """Find the depth camera that aligns depth with color.

    The intrinsics of a recording may belong to either camera. If the recording has poses, the registration with the
    best agreement of views is used, and none if no agreement is clearly better than without; otherwise the intrinsics
    are assigned to the color camera.

    Parameters
    ----------
    recording : Recording
    """
    K = recording.intrinsics
    aligned = DepthCamera(K.fx, K.fy, K.cx, K.cy, (K.width, K.height), np.eye(4))
    start = recording.depth_camera or aligned
    unposed = recording.without_poses()
    frames = unposed.with_depth_camera(start)  # without the removal of color's lens distortion from depth
    found = misregistration_of(frames.read, range(len(frames)))
    if found is None or not found.clear:
        return Registration(found, recording)
    color = _color_camera(found, K)
    if not _is_plausible(found, color, K):
        return Registration(found, recording, "no two cameras side by side are displaced like this")
    candidates = [recording.with_depth_camera(_moved(start, found, K))]
    if recording.depth_camera is None:
        beside = assembled(np.eye(3), (found.apart_px_m / color.fx, 0.0, 0.0))
        depth = DepthCamera(K.fx, K.fy, K.cx, K.cy, (K.width, K.height), beside)
        candidates.append(recording.with_intrinsics(color).with_depth_camera(depth))
    before = _fit(recording)
    if before is None:
        return Registration(found, candidates[0])
    fits = [(fit, candidate) for candidate in candidates if (fit := _fit(candidate)) is not None]
    good = [(fit, candidate) for fit, candidate in fits if fit.is_better_than(before)]
    if not good:
        return Registration(found, recording, "no registration fits the given poses")
    return Registration(found, min(good, key=lambda pair: pair[0].disagreement)[1])


def _is_plausible(found: Misregistration, color: Intrinsics, K: Intrinsics) -> bool:
    """Return whether the cameras of a device can have a misalignment.

    Parameters
    ----------
    found : Misregistration
    color : Intrinsics
        The color camera, if `K` belongs to the depth camera.
    K : Intrinsics
        The named intrinsics.
    """
    focal = max(found.magnification, 1.0 / found.magnification)
    off_px = float(np.hypot(color.cx - K.cx, color.cy - K.cy))
    return focal <= FARTHEST_FOCAL and off_px <= FARTHEST_CENTER * K.width


@dataclass(frozen=True, slots=True)
class _Fit:
    """How a recording's views agree under its poses.

    Attributes
    ----------
    disagreement : float
        Of depth and color, 0 to 2, see `Problem.disagreement`.
    gap_m : float
        Median difference of depths; it tells whether depth fits the poses, wherever color lies.
    """

    disagreement: float
    gap_m: float

    def is_better_than(self, other: _Fit) -> bool:
        """Return whether color fits clearly better, and depth no worse."""
        return (
            self.disagreement <= (1.0 - CLEARLY_FITS) * other.disagreement
            and self.gap_m <= (1.0 + DEPTH_FITS) * other.gap_m
        )


def _fit(recording: Recording) -> _Fit | None:
    """Return how a recording's views agree under its poses; None if it has none, or too few views overlap."""
    if not recording.has_poses:
        return None
    chosen = spread_out(usable_poses(recording, range(len(recording))), VIEWS)
    factor, _ = factors(recording.intrinsics.width)
    views = [build_view(frame, factor) for frame in usable_frames(recording.read, chosen)]
    pinhole = ScaledPinhole.of(recording.intrinsics)
    pairs = choose_pairs(views, pinhole.resized(factor))
    if len(pairs) < MIN_PAIRS:
        return None
    problem = Problem(views, pairs, factor)
    return _Fit(problem.solve(pinhole, (), FIT_STEPS, trusting=True).disagreement, problem.typical_gap_m(pinhole))


def _color_camera(found: Misregistration, K: Intrinsics) -> Intrinsics:
    """Return the color camera, if `K` (pixels) belongs to the depth camera."""
    g, (du, dv), middle = found.magnification, found.shift_px, ((K.width - 1) / 2, (K.height - 1) / 2)
    cx, cy = middle[0] + g * (K.cx - middle[0]) + du, middle[1] + g * (K.cy - middle[1]) + dv
    return Intrinsics(g * K.fx, g * K.fy, cx, cy, K.width, K.height)


def _moved(start: DepthCamera, found: Misregistration, K: Intrinsics) -> DepthCamera:
    """Return the depth camera whose edges agree with color, if `K` (pixels) belongs to the color camera.

    To first order in the angle between the cameras: (u, v) of `start` is f_color / f (pixel - c) + c_color, and
    so is that of the new one, whose f and c follow.
    """
    g, half = found.magnification, ((K.width - 1) / 2, (K.height - 1) / 2)
    cx = start.cx + start.fx / (g * K.fx) * ((K.cx - half[0]) * (1 - g) - found.shift_px[0])
    cy = start.cy + start.fy / (g * K.fy) * ((K.cy - half[1]) * (1 - g) - found.shift_px[1])
    T = start.T_color_depth.copy()
    T[:2, 3] *= g
    T[0, 3] += found.apart_px_m / K.fx
    return DepthCamera(start.fx / g, start.fy / g, cx, cy, start.size, T, start.distortion)


def registration_warning(read: Callable[[int], Frame], intrinsics: Intrinsics, frames: Sequence[int]) -> str | None:
    """Return a one-line warning if depth and color are clearly misaligned in frames of a run, else None.

    Parameters
    ----------
    read : callable
        Returns a frame by its number; raises FrameError if it cannot be used.
    intrinsics : Intrinsics
        Intrinsics of the frames.
    frames : sequence of int
        Numbers of the frames that were used.
    """
    if len(frames) < MIN_FRAMES:
        return None
    found = misregistration_of(read, frames)
    if found is None or not is_off(found, intrinsics):
        return None
    return f"{displaced(found)}: it is not registered; use --register on, or describe the depth camera in camera.json"


def displaced(found: Misregistration) -> str:
    """Return the beginning of the warnings about depth that is displaced from color."""
    return f"{DISPLACED} by about {found.off_px:.0f} px"


def is_off(found: Misregistration, intrinsics: Intrinsics) -> bool:
    """Tell whether depth is clearly misaligned, by more than the apparent offset of stereo cameras."""
    return found.clear and found.off_px >= WORTH_A_WARNING * intrinsics.width
