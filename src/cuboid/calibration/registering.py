"""Finds how far depth is off color: the ends of surfaces in depth, against edges in color.

A camera image rarely shows no edge where a surface ends before another. Where depth is not registered, its ends lie
beside the edges of color, all over the image and in all frames in the same manner: magnified, shifted, and, where
the two cameras are apart, shifted by more the nearer they are. That manner is searched for. Whether it counts is asked
of frames that it was not found in: what was found in every second frame must hold in the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from cuboid.calibration.calibrate import MIN_PAIRS, spread_out
from cuboid.calibration.edge_fit import (
    FINE_BLUR_PX,
    FINER,
    NOWHERE,
    SEARCH_BLUR_PX,
    different_views,
    fit_baseline,
    fit_move,
    gain_of,
    gather_edges,
    size_of,
)
from cuboid.calibration.pairs import choose_pairs
from cuboid.calibration.solving import Problem
from cuboid.calibration.views import Pinhole, build_view, factors
from cuboid.core.errors import FrameError
from cuboid.core.frame import Float64Array, Frame, Intrinsics
from cuboid.readers.depth_camera import DepthCamera
from cuboid.readers.recording import Recording

# This many frames are examined.
FRAMES = 12
# A run of fewer is not checked.
MIN_FRAMES = 8
# Depth counts as off if it is so by this fraction of the image's width (4 of 640 pixels: the ends of surfaces are that
# uncertain), found alike in both halves of the frames, to this fraction of it or 3 of 640 pixels, and the edges of
# frames that it was not found in agree better by this much and by this many standard errors. Registered recordings gain
# up to 0.04, made ones that are 6 pixels off 0.14. Stereo, to which things look larger than they are, feigns up to 8 of
# 640 pixels: below 10 none is warned.
CLEARLY_OFF, WORTH_A_WARNING = 0.006, 0.0156
ALIKE, ALIKE_AT_LEAST = 0.35, 0.005
CLEAR_GAIN, CLEAR_ERRORS = 0.03, 4.0
# A magnification within this of 1 comes from the edges' uncertainty: both cameras have the same focal length.
SAME_FOCAL = 0.02
# Views that tell which camera the named intrinsics belong to, and steps of fitting their poses.
VIEWS, STEPS = 24, 12
# Frames that see the same count once.
MIN_VIEWS = 3


@dataclass(frozen=True, slots=True)
class Misregistration:
    """How far depth is off color.

    Depth at pixel (u, v) and z metres belongs to `center + magnification ((u, v) - center) + shift_px`, and by
    `apart_px_m / z` more along the row; center is the middle of the image.

    Attributes
    ----------
    clear : bool
        Whether the frames show clearly that it is off.
    off_px : float
        By how much, root mean square over the image, pixels.
    magnification : float
    shift_px : (float, float)
    apart_px_m : float
        0 where nothing tells.
    views : int
        Different views that told.
    """

    clear: bool
    off_px: float
    magnification: float
    shift_px: tuple[float, float]
    apart_px_m: float
    views: int


def find_misregistration(frames: Iterable[Frame]) -> Misregistration | None:
    """Find how far depth is off color.

    Parameters
    ----------
    frames : iterable of Frame
        About `FRAMES`, from different places; with that many it takes about half a second.

    Returns
    -------
    Misregistration or None
        None where the frames show no ends of surfaces.
    """
    found = gather_edges(frames)
    if found is None:
        return None
    edges, factor = found
    views, width = different_views(edges), edges.strength.shape[3]
    levels = {sigma: edges.blurred(sigma) for sigma in (SEARCH_BLUR_PX, *(one[0] for one in FINER))}
    fine = levels[FINE_BLUR_PX]
    move = fit_move(levels, NOWHERE)
    off = size_of(edges, move - NOWHERE)
    before, after = fine.agreement_inside(np.stack([NOWHERE, move]))
    clear = bool(views >= MIN_VIEWS and off > CLEARLY_OFF * width and after - before > CLEAR_GAIN)
    if clear:  # only then is it worth the time
        even = edges.image % 2 == 0
        fits = [
            fit_move({sigma: level.chosen(half) for sigma, level in levels.items()}, move) for half in (even, ~even)
        ]
        gain, error = gain_of(fine, *fits)
        alike = size_of(edges, fits[0] - fits[1]) < max(ALIKE * off, ALIKE_AT_LEAST * width)
        clear = alike and gain > max(CLEAR_GAIN, CLEAR_ERRORS * error)
    g, du, dv, p, _ = fit_baseline(fine, move).tolist()
    return Misregistration(clear, factor * off, g, (factor * du, factor * dv), factor * p, views)


def register_recording(recording: Recording) -> tuple[Misregistration | None, Recording]:
    """Find the depth camera with which depth comes to lie on color.

    The intrinsics that a recording names may be those of either camera. Where both readings differ and the recording
    has poses, the one with which the views agree better is taken; else they are the color camera's.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    Misregistration or None
        How far depth was off color, as far as the frames show it.
    Recording
        With that depth camera, and with the color camera's intrinsics; the same where nothing is clearly off.
    """
    K = recording.intrinsics
    aligned = DepthCamera(K.fx, K.fy, K.cx, K.cy, (K.width, K.height), np.eye(4))
    start = recording.depth_camera or aligned
    bare = recording.without_poses()
    frames = bare.with_depth_camera(start)  # without what takes color's lens out of depth that is color's own
    found = find_misregistration(_spread(frames.read, range(len(frames))))
    if found is None or not found.clear:
        return found, recording
    of_color = recording.with_depth_camera(_moved(start, found, K))
    if recording.depth_camera is not None or abs(found.magnification - 1.0) < SAME_FOCAL:
        return found, of_color
    color = _color_camera(found, K)
    depth = DepthCamera(K.fx, K.fy, K.cx, K.cy, (K.width, K.height), _beside(found, color))
    of_depth = recording.with_intrinsics(color).with_depth_camera(depth)
    return found, min((of_color, of_depth), key=_disagreement)


def _disagreement(recording: Recording) -> float:
    """Return how far the views of a recording disagree with each other by its poses; 0 where nothing tells."""
    if not recording.has_poses:
        return 0.0
    poses = {}
    for index in range(len(recording)):
        with suppress(FrameError):
            pose = recording.pose(index)
            if pose is not None:
                poses[index] = pose
    factor, _ = factors(recording.intrinsics.width)
    views = [build_view(frame, factor) for frame in _read(recording.read, spread_out(poses, VIEWS))]
    pinhole = Pinhole.of(recording.intrinsics)
    pairs = choose_pairs(views, pinhole.resized(factor))
    if len(pairs) < MIN_PAIRS:
        return 0.0
    return Problem(views, pairs, factor).solve(pinhole, (), STEPS, trusting=True).disagreement


def _color_camera(found: Misregistration, K: Intrinsics) -> Intrinsics:
    """Return the color camera where `K` (pixels) is the depth camera's."""
    g, (du, dv), middle = found.magnification, found.shift_px, ((K.width - 1) / 2, (K.height - 1) / 2)
    cx, cy = middle[0] + g * (K.cx - middle[0]) + du, middle[1] + g * (K.cy - middle[1]) + dv
    return Intrinsics(g * K.fx, g * K.fy, cx, cy, K.width, K.height)


def _beside(found: Misregistration, color: Intrinsics) -> Float64Array:
    """Return T_color_depth (4, 4) of a depth camera that looks the same way."""
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = found.apart_px_m / color.fx
    return T_color_depth


def _moved(start: DepthCamera, found: Misregistration, K: Intrinsics) -> DepthCamera:
    """Return the depth camera whose readings lie where the edges agree, where `K` (pixels) is the color camera's.

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
    """Return one line where depth is clearly off color in some frames of a run, else None.

    Parameters
    ----------
    read : callable
        Gives a frame by its number; raises FrameError where it cannot be used.
    intrinsics : Intrinsics
        Of its frames.
    frames : sequence of int
        Numbers of those that were used.
    """
    if len(frames) < MIN_FRAMES:
        return None
    found = find_misregistration(_spread(read, frames))
    if found is None or not is_off(found, intrinsics):
        return None
    return (
        f"depth is displaced from color by about {found.off_px:.0f} px: it is not registered; use --register on, or "
        "describe the depth camera in camera.json"
    )


def is_off(found: Misregistration, intrinsics: Intrinsics) -> bool:
    """Tell whether depth lies beside color clearly, and by more than the parallax of stereo cameras feigns."""
    return found.clear and found.off_px >= WORTH_A_WARNING * intrinsics.width


def _spread(read: Callable[[int], Frame], frames: Sequence[int]) -> Iterable[Frame]:
    """Read some frames, evenly over all."""
    chosen = np.linspace(0, len(frames) - 1, min(FRAMES, len(frames))).round().astype(int)
    return _read(read, [frames[k] for k in chosen.tolist()])


def _read(read: Callable[[int], Frame], frames: Iterable[int]) -> Iterable[Frame]:
    """Read frames; bad ones are left out."""
    for index in frames:
        with suppress(FrameError):
            yield read(index)
