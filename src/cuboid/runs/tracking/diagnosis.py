"""Likely faults of a run, derived from its facts at the end: one line each, with a command that helps."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from cuboid.ground.core.errors import counted
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.plausible import FARTHEST_MEDIAN_M, is_plausible, scale_warning
from cuboid.ground.core.pose_convention import advised
from cuboid.ground.core.results import FrameResult

if TYPE_CHECKING:
    from cuboid.inputs.calibration.pose_fit import PoseFit

# A frame's depth is examined in every PIXEL_STEP-th row and column: 0.1 ms.
PIXEL_STEP = 8
# Fraction of lost frames, or of frames without a pose, that gives a warning, and their smallest number.
MANY_LOST, MIN_LOST = 0.1, 3
# Fraction of pixels with readings below which a warning is given; real recordings at hand have 29 to 100 %.
FEW_READINGS = 0.15
# Largest distance at which objects are found, metres.
MAX_OBJECT_DISTANCE_M = 4.0
# Points in results are 32-bit numbers; above this step between two such numbers, metres, rounding is larger than the
# noise of a depth camera at half a metre (about 1 mm), and shapes of small objects show it.
COARSE_STEP_M = 0.002
# The poses of real recordings at hand explain 79 to 98 % of the depth of other frames; wrong poses explain up to 35 %
# unless the camera hardly moves. Another convention or scale must explain at least CLEARLY_MORE than the given poses,
# and at least EXPLAINED.
UNEXPLAINED_BELOW, CLEARLY_MORE, EXPLAINED = 0.35, 0.1, 0.6
# Fewer frames than this may leave too much hidden or unsure.
FEW_FRAMES = 10

HELP = "docs/finds-nothing.md lists further checks"


@dataclass(slots=True)
class Counts:
    """Counts for the diagnosis, accumulated frame by frame.

    Attributes
    ----------
    proposals : int
        3D proposals of the used frames.
    depth_fraction, depth_median_m : dict of int to float
        By the index of each used frame: the fraction of pixels with a reading, and the median of the readings.
    constant : set of int
        Indices of the used frames with one depth in all pixels.
    """

    proposals: int = 0
    depth_fraction: dict[int, float] = field(default_factory=dict)
    depth_median_m: dict[int, float] = field(default_factory=dict)
    constant: set[int] = field(default_factory=set)

    def add(self, frame: Frame, result: FrameResult) -> None:
        """Count a used frame."""
        depth_m = frame.depth_m[::PIXEL_STEP, ::PIXEL_STEP]
        readings = depth_m[depth_m > 0]
        self.depth_fraction[frame.index] = readings.size / depth_m.size
        if readings.size:
            self.depth_median_m[frame.index] = float(np.median(readings))
            if readings.min() == readings.max() and frame.depth_m.min() == frame.depth_m.max():
                self.constant.add(frame.index)
        self.proposals += len(result.proposals)

    def mostly_constant(self, frames: Collection[int]) -> bool:
        """Return whether most of these frames have one depth in all pixels: noise of a camera makes no such frame."""
        return sum(frame in self.constant for frame in frames) > len(frames) / 2


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Facts of a run at its end.

    Attributes
    ----------
    frames_read, frames_used : int
    frames_lost : int
        Number of frames in which the camera was lost while poses were estimated.
    frames_without_pose : int
        Number of frames that lack a given pose.
    frames_without_depth : int
        Number of frames without any reading of depth.
    depth_constant : bool
        Whether most used frames have one depth in all pixels.
    every : int
        Step between the frames that were read.
    depth_fraction, depth_median_m : float or None
        Medians over the used frames, see `Counts`; None without used frames.
    depth_units_per_metre : float
    pose_fit : PoseFit or None
        Fit of given poses; None for estimated poses, or if too few frames can be compared.
    up_known : bool
    planes, proposals, objects : int
        Numbers of supporting planes, of 3D proposals in all frames, and of confirmed objects.
    farthest_m : float
        Largest coordinate of a camera in the world.
    untimely : tuple of int
        Frames whose time is not later than that of the frame before.
    field_of_view : str or None
        The warning about the field of view of the intrinsics.
    calibration, registration, misfit : str or None
        What the check of the intrinsics and the depth scale, the check of the registration of depth to color, and the
        source of the poses found wrong.
    """

    frames_read: int
    frames_used: int
    frames_lost: int
    frames_without_pose: int
    every: int
    depth_fraction: float | None
    depth_median_m: float | None
    depth_units_per_metre: float
    pose_fit: PoseFit | None
    up_known: bool
    planes: int
    proposals: int
    objects: int
    frames_without_depth: int = 0
    depth_constant: bool = False
    farthest_m: float = 0.0
    untimely: tuple[int, ...] = ()
    field_of_view: str | None = None
    calibration: str | None = None
    registration: str | None = None
    misfit: str | None = None


def median_or_none(values: Collection[float]) -> float | None:
    """Return the median; None for an empty list."""
    return float(np.median(list(values))) if values else None


def diagnose(facts: RunFacts) -> tuple[str, ...]:
    """Return the warnings about a run, one line each, causes before their effects; empty if nothing is wrong.

    Depth, intrinsics and poses that do not fit together get one warning, that of the best proven cause. An empty result
    is a separate warning, if no other warning explains it.
    """
    mismatch = _scale_or_poses(facts)
    if mismatch is None and facts.registration is None:  # color beside depth disturbs the other checks
        mismatch = facts.calibration or facts.field_of_view or facts.misfit
    causes = (
        _constant_depth(facts),
        mismatch,
        facts.registration,
        _without_depth(facts),
        _few_readings(facts),
        _lost(facts),
        _without_pose(facts),
    )
    explained = any(cause is not None for cause in causes)
    found = tuple(cause for cause in (*causes, _far_world(facts), _untimely(facts)) if cause is not None)
    return (*found, _no_object(facts)) if not (explained or facts.objects) and facts.frames_used else found


def _constant_depth(facts: RunFacts) -> str | None:
    if not facts.depth_constant or facts.depth_median_m is None:
        return None
    return (
        f"most frames have the same depth in all their pixels ({facts.depth_median_m:.3g} m): no camera measures this; "
        "check the source of the depth images"
    )


def _lost(facts: RunFacts) -> str | None:
    if facts.frames_lost < max(MIN_LOST, MANY_LOST * facts.frames_read):
        return None
    advice = (
        "read all frames with --every 1"
        if facts.every > 1
        else "move the camera more slowly, and keep texture and depth in the picture"
    )
    return f"the camera was lost in {facts.frames_lost} of {facts.frames_read} frames; {advice}"


def _without_pose(facts: RunFacts) -> str | None:
    if facts.frames_without_pose < max(MIN_LOST, MANY_LOST * facts.frames_read):
        return None
    return (
        f"{facts.frames_without_pose} of {facts.frames_read} frames have no camera pose and were not used; "
        "--bridge estimates these poses"
    )


def _without_depth(facts: RunFacts) -> str | None:
    if facts.frames_without_depth < max(MIN_LOST, MANY_LOST * facts.frames_read):
        return None
    return (
        f"{facts.frames_without_depth} of {facts.frames_read} frames have no reading of depth and were not used: every "
        "pixel is 0, negative or not a number; check the source of the depth images"
    )


def _far_world(facts: RunFacts) -> str | None:
    """Return the warning about a world whose origin is so far away that 32-bit coordinates of points are coarse."""
    step_m = float(np.spacing(np.float32(facts.farthest_m)))
    if step_m <= COARSE_STEP_M:
        return None
    return (
        f"the camera is {facts.farthest_m / 1000:.0f} km from the origin of its world: points of the map are stored in "
        f"steps of {100 * step_m:.2g} cm (32-bit numbers), boxes exactly; subtract an offset from all poses"
    )


def _untimely(facts: RunFacts) -> str | None:
    """Return the warning about times that repeat or go back."""
    if not facts.untimely:
        return None
    where = f"at {counted(len(facts.untimely), 'frame')}, first at frame {facts.untimely[0]}"
    return f"times repeat or go back {where}; motion of objects is measured with times that increase"


def _few_readings(facts: RunFacts) -> str | None:
    if facts.depth_fraction is None or facts.depth_fraction >= FEW_READINGS:
        return None
    return (
        f"depth has few readings: {_percent(facts.depth_fraction)} of the pixels (median); surfaces may be too near, "
        "too far, black or of glass; 'cuboid info RECORDING --all' shows the range of the depth"
    )


def explains(fit: PoseFit) -> bool:
    """Return whether no other convention, time shift or depth scale explains the frames clearly better."""
    other = max(fit.converted, fit.shifted, fit.scaled)
    return other < _enough(fit) and (fit.given is None or fit.given >= UNEXPLAINED_BELOW)


def _proves_scale(fit: PoseFit) -> bool:
    """Return whether the frames agree with the poses at this depth scale, and clearly less at any other scale."""
    return fit.moves and (fit.given or 0.0) >= max(EXPLAINED, fit.scaled + CLEARLY_MORE, fit.still + CLEARLY_MORE)


def _enough(fit: PoseFit) -> float:
    """Return the fraction of the depth that a clearly better hypothesis than the given poses must explain."""
    return max((fit.given or 0.0) + CLEARLY_MORE, EXPLAINED)


def _scale_or_poses(facts: RunFacts) -> str | None:
    """Return the warning about a wrong depth scale or wrong poses, if the frames prove it."""
    fit, units = facts.pose_fit, facts.depth_units_per_metre
    if fit is not None:
        better = _better_hypothesis(fit, units)
        if better is not None:
            return better
    median_m = facts.depth_median_m
    if median_m is not None and not is_plausible(median_m):
        if fit is not None and _proves_scale(fit):
            where = "far away" if median_m > FARTHEST_MEDIAN_M else "near"
            return (
                f"the median depth is {median_m:.2g} m, and depth and poses agree in scale: if the scene is not that "
                f"{where}, both are in another unit than metres"
            )
        return scale_warning(median_m, units)
    return None if fit is None else _unexplained(fit)


def _better_hypothesis(fit: PoseFit, units: float) -> str | None:
    """Return the warning about a convention, time shift or depth scale that explains clearly more depth."""
    best = max(fit.scaled, fit.converted, fit.shifted)
    if best < _enough(fit):
        return None
    fits = f"{_percent(best)} of the depth agrees with other frames, instead of {_percent(fit.given or 0.0)}"
    if fit.scaled == best:
        return (
            f"the depth scale of {units:g} units per metre is wrong: with {units / fit.depth_factor:g}, "
            f"{fits}; run again with --depth-scale {units / fit.depth_factor:g}"
        )
    if fit.converted == best:
        return advised(fit.convention, fits)
    late = "late" if fit.shift > 0 else "early"
    return (
        f"the given poses are {counted(abs(fit.shift), 'frame')} too {late}: with corrected times, {fits}; "
        "correct the times, or run again with --poses estimated"
    )


def _unexplained(fit: PoseFit) -> str | None:
    """Return the warning about given poses that explain the frames in no convention."""
    if not fit.moves and (fit.given or 0.0) < EXPLAINED:
        return (
            "the given poses are all the same, but the picture changes: "
            f"only {_percent(fit.given or 0.0)} of the depth agrees with other frames; run again with --poses estimated"
        )
    if fit.given is not None and fit.given < UNEXPLAINED_BELOW:
        return (
            f"the given poses do not explain the frames: only {_percent(fit.given)} of the depth agrees with other "
            "frames; are they of another recording? run again with --poses estimated"
        )
    if fit.jump is not None:
        return (
            f"the given poses jump by {fit.jump.step_m:.1f} m at frame {fit.jump.frame}, but the frames show no jump; "
            "track the parts one by one, or run again with --poses estimated"
        )
    return None


def _no_object(facts: RunFacts) -> str:
    """Return the warning about an empty result that no other warning explains, with the most likely reason."""
    if facts.frames_used < FEW_FRAMES:
        advice = "--every 1 reads all" if facts.every > 1 else "record more"
        frames = counted(facts.frames_used, "frame")
        return f"no object found in {frames}: none is probable enough; {advice}, or give a lower --min-probability"
    if facts.depth_median_m is not None and facts.depth_median_m > MAX_OBJECT_DISTANCE_M:
        return (
            f"no object found: the median depth is {facts.depth_median_m:.1f} m, objects are found up to "
            f"{MAX_OBJECT_DISTANCE_M:g} m; move nearer, or correct the scale with --depth-scale"
        )
    if not facts.up_known:
        return (
            "no object found, and up is not known: no floor or table was seen; keep the surface below the objects in "
            "the picture, or give 'up_world' in camera.json"
        )
    if not facts.proposals:
        return f"no object found: no frame had a 3D proposal; check 'cuboid render DIR --show heat'; {HELP}"
    return (
        f"no object found: {facts.proposals} 3D proposals in {facts.frames_used} frames, none confirmed; "
        f"check 'cuboid render DIR --show planes'; {HELP}"
    )


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.0f} %"
