"""A summary of a recording from some of its frames, for `cuboid info`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.plausible import field_of_view_warning, scale_warning
from cuboid.ground.core.skipped import SkippedKind, skipped_kinds
from cuboid.inputs.calibration.registering import find_misregistration
from cuboid.inputs.readers import Recording

# Number of decoded frames, evenly spaced, and of frames whose poses are examined.
FRAMES, POSES = 24, 500
# A time step longer than this multiple of the median step is a gap.
GAP_STEPS = 5.0


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """The summary of a recording.

    Attributes
    ----------
    path, format : str
    frames : int
    looked_at : int
        Number of frames that were decoded.
    size : (int, int)
        Width and height of the frames, pixels.
    intrinsics : (float, float, float, float)
        fx, fy, cx, cy of the frames, pixels.
    intrinsics_source : str
    distortion : tuple of float
        Distortion coefficients; the frames are undistorted with them.
    depth_camera : dict or None
        Depth camera and T_color_depth, as in `camera.json`, if depth was registered to color.
    depth_units_per_metre : float
    depth_range_m : (float, float) or None
        5th and 95th percentile of the readings.
    holes : float or None
        Fraction of the pixels without a reading.
    has_timestamps : bool
    rate_hz, duration_s : float or None
    gaps : int
        Number of time steps that are much longer than usual.
    poses : int
        Number of frames with a pose, out of `poses_looked_at`.
    poses_looked_at : int
    path_length_m : float or None
    up_world : (float, float, float) or None
        Up (opposite to gravity), if the recording has it.
    up_measured : bool
        Whether up was measured together with the frames.
    depth_off_px : float or None
        Offset between depth and color, if it is clear.
    depth_views : int
        Number of different views in which depth edges were compared with color; 0 if too few edges were found.
    skipped : tuple of SkippedKind
        Kinds of frames that cannot be used, the most frequent first.
    warnings : tuple of str
        Warnings for the user, such as images that were left out, or a depth scale that is not plausible.
    """

    path: str
    format: str
    frames: int
    looked_at: int
    size: tuple[int, int]
    intrinsics: tuple[float, float, float, float]
    intrinsics_source: str
    distortion: tuple[float, ...]
    depth_camera: dict[str, Any] | None
    depth_units_per_metre: float
    depth_range_m: tuple[float, float] | None
    holes: float | None
    has_timestamps: bool
    rate_hz: float | None
    duration_s: float | None
    gaps: int
    poses: int
    poses_looked_at: int
    path_length_m: float | None
    up_world: tuple[float, ...] | None
    up_measured: bool
    depth_off_px: float | None
    depth_views: int
    skipped: tuple[SkippedKind, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the summary, ready for JSON."""
        values = {name: getattr(self, name) for name in self.__slots__}
        values["skipped"] = [{"count": s.count, "frame": s.frame, "reason": s.reason} for s in self.skipped]
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def inspect_recording(recording: Recording, *, every_frame: bool = False) -> RecordingInfo:
    """Return a summary of a recording.

    Parameters
    ----------
    recording : Recording
    every_frame : bool
        Decode all frames instead of `FRAMES`.
    """
    count = len(recording)
    chosen = range(count) if every_frame else _spread(count, FRAMES)
    unposed, K = recording.without_poses(), recording.intrinsics
    reasons: dict[int, str] = {}
    fractions, ranges, medians, kept = [], [], [], []
    for index in chosen:
        try:
            frame = unposed.read(index)
        except FrameError as error:
            reasons[index] = str(error)
            continue
        seen = frame.depth_m[frame.depth_m > 0]
        fractions.append(1 - seen.size / frame.depth_m.size)
        ranges.append(np.percentile(seen, (5, 95)))
        medians.append(float(np.median(seen)))
        kept.append(index)
    poses, length_m, looked_at = _poses(recording, reasons, range(count) if every_frame else _spread(count, POSES))
    rate_hz, duration_s, gaps = _times(recording)
    near, far = np.median(ranges, axis=0).tolist() if ranges else (None, None)
    scale = scale_warning(float(np.median(medians)), recording.depth_units_per_metre) if medians else None
    doubts = [one for one in (scale, field_of_view_warning(K)) if one is not None]
    misregistration = find_misregistration([unposed.read(index) for index in kept[:: max(1, len(kept) // 12)]])
    return RecordingInfo(
        path=str(recording.path),
        format=recording.format,
        frames=count,
        looked_at=len(chosen),
        size=(K.width, K.height),
        intrinsics=(K.fx, K.fy, K.cx, K.cy),
        intrinsics_source=recording.calibration.source,
        distortion=recording.distortion,
        depth_camera=None if recording.depth_camera is None else recording.depth_camera.document(),
        depth_units_per_metre=recording.depth_units_per_metre,
        depth_range_m=None if near is None or far is None else (near, far),
        holes=float(np.mean(fractions)) if fractions else None,
        has_timestamps=recording.has_timestamps,
        rate_hz=rate_hz,
        duration_s=duration_s,
        gaps=gaps,
        poses=poses,
        poses_looked_at=looked_at,
        path_length_m=length_m,
        up_world=None if recording.up_world is None else tuple(recording.up_world.tolist()),
        up_measured=recording.up_measured,
        depth_off_px=misregistration.off_px if misregistration is not None and misregistration.clear else None,
        depth_views=0 if misregistration is None else misregistration.views,
        skipped=tuple(skipped_kinds(sorted(reasons.items()))),
        warnings=(*recording.warnings, *doubts),
    )


def _spread(count: int, most: int) -> list[int]:
    return sorted({int(k) for k in np.linspace(0, count - 1, min(most, count)).round()})


def _poses(recording: Recording, reasons: dict[int, str], chosen: Sequence[int]) -> tuple[int, float | None, int]:
    """Return the number of frames with a pose, the path length, and the number of examined frames."""
    if not recording.has_poses:
        return 0, None, 0
    places: list[Float64Array] = []
    for index in chosen:
        try:
            T = recording.pose(index)
        except FrameError as error:
            reasons.setdefault(index, str(error))
            continue
        if T is not None:
            places.append(T[:3, 3])
    steps = np.diff(np.array(places), axis=0) if len(places) > 1 else np.zeros((0, 3))
    return len(places), float(np.linalg.norm(steps, axis=1).sum()), len(chosen)


def _times(recording: Recording) -> tuple[float | None, float | None, int]:
    """Return rate, duration, and number of gaps."""
    times = np.array([recording.timestamp_s(k) for k in range(len(recording))])
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if usual <= 0:
        return None, float(times[-1] - times[0]) if len(times) else None, 0
    return 1 / usual, float(times[-1] - times[0]), int((steps > GAP_STEPS * usual).sum())
