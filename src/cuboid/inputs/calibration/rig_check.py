"""Whether a fixed camera was knocked: each minute, what it sees is aligned to what it saw at the start."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry.se3 import angle, transform
from cuboid.inputs.calibration.rig_fit import FEW_POINTS, REACHES_M, StillView, align, still_view
from cuboid.inputs.readers import Recording

# Time between two checks, seconds; largest number of checks; frames of each check.
EVERY_S, MAX_CHECKS, FRAMES = 60.0, 10, 6
# A camera was knocked if it sees the scene displaced by more than this, metres: a voxel, which moves points in the map.
KNOCKED_M = 0.01


def knocked_warning(recording: Recording, name: str) -> str | None:
    """Return a warning if a fixed camera moved during its recording; None if it stood still, or too little is seen.

    Parameters
    ----------
    recording : Recording
    name : str
        Name of the camera.
    """
    bare = recording.without_poses()
    starts = [0, *_checks(bare)]
    if len(starts) < 2:
        return None
    first = _view(bare, 0)
    if first is None:
        return None
    for start in starts[1:]:
        later = _view(bare, start)
        if later is None:
            continue
        T = align([first, later], np.array([np.eye(4)] * 2), REACHES_M[:3], FEW_POINTS)[1]
        shift_m = float(np.median(np.linalg.norm(transform(T, later.points) - later.points, axis=1)))
        if shift_m > KNOCKED_M:
            return (
                f"camera {name} was knocked: {bare.timestamp_s(start) - bare.timestamp_s(0):.0f} s after its start "
                f"it sees the scene {1000 * shift_m:.0f} mm and {np.degrees(angle(T)):.1f} degrees displaced; its "
                "pose in rig.json is no longer valid"
            )
    return None


def _view(recording: Recording, start: int) -> StillView | None:
    """Return what some frames show that stands still; None if it is too little."""
    try:
        return still_view(_frames(recording, start), recording.intrinsics)
    except InputError:
        return None


def _checks(recording: Recording) -> list[int]:
    """Return the first frames of the checks: the last one ends with the recording."""
    last, times_s = len(recording) - FRAMES, [recording.timestamp_s(k) for k in range(len(recording))]
    if last < FRAMES:
        return []
    minutes = np.arange(times_s[0] + EVERY_S, times_s[last], EVERY_S)
    found = [*np.searchsorted(times_s, minutes).tolist(), last]
    return [found[int(k)] for k in np.unique(np.linspace(0, len(found) - 1, min(len(found), MAX_CHECKS)).round())]


def _frames(recording: Recording, start: int) -> Iterator[Frame]:
    for index in range(start, start + FRAMES):
        with suppress(FrameError):
            yield recording.read(index)
