"""Several recordings as one: the frames of all cameras of a rig, in the order of their times.

Expected tree::

    my-rig/                  <- the recording
      rig.json               {"format": "cuboid-rig", "version": 1, "kind": "fixed", "cameras": [{"name": "left",
                              "recording": "left", "T_rig_camera": [[...], ...]}, ...]}
      left/  right/  ...     a recording of any format for each camera, with a common clock
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, Rig, RigCamera
from cuboid.ground.formats import rig_file
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.rig_file import FIXED, RigDocument
from cuboid.ground.geometry.se3 import exp, inverse, log, tidied
from cuboid.inputs.readers import Recording

RIG_FILE, FORMAT = "rig.json", "rig"
# A camera that starts later or ends earlier than the others by more than this is named in a warning, seconds.
LATE_S = 1.0
# The pose of a moving rig is interpolated between two posed frames that are no farther apart than this, seconds, and
# extrapolated from them for no longer. A hand-held camera accelerates by 2 m/s2: within this time, interpolation is
# 2.5 mm off, a quarter of a voxel, and in twice the time a voxel. The last millisecond allows for rounded times.
MAX_GAP_S = 0.101


def is_rig(path: Path) -> bool:
    """Return whether a path is a rig: a .json file that names its format, or a folder with a `rig.json`."""
    if path.suffix == ".json" and path.is_file():
        return path.name == RIG_FILE or f'"{rig_file.FORMAT}"' in path.read_text(encoding="utf-8", errors="replace")
    return (path / RIG_FILE).is_file()


def read_rig(path: Path) -> tuple[Path, RigDocument]:
    """Return the file of a rig and its content.

    Raises
    ------
    InputError
        The file is malformed; the message is one line.
    """
    file = path / RIG_FILE if path.is_dir() else path
    return file, read_json(file, RigDocument)


def recordings_of(file: Path, rig: RigDocument, given: Sequence[Path]) -> list[Path]:
    """Return the path of each camera's recording: the given ones, else those that the file names.

    Raises
    ------
    InputError
        There is not one recording for each camera.
    """
    if given and len(given) != len(rig.cameras):
        names = ", ".join(camera.name for camera in rig.cameras)
        raise InputError(f"{file}: has {len(rig.cameras)} cameras ({names}), but {len(given)} recordings were given")
    if given:
        return list(given)
    missing = next((camera.name for camera in rig.cameras if camera.recording is None), None)
    if missing is not None:
        raise InputError(f"{file}: camera '{missing}' has no 'recording'; name one recording for each camera")
    return [file.parent / str(camera.recording) for camera in rig.cameras]


@dataclass(frozen=True, slots=True)
class RigPart:
    """A camera of a rig with its recording.

    Attributes
    ----------
    camera : RigCamera
    recording : Recording
    T_rig_camera : (4, 4) float64 or None
        None if the recording's own poses are in the common world.
    """

    camera: RigCamera
    recording: Recording
    T_rig_camera: Float64Array | None

    def times_s(self) -> list[float]:
        """Return the times of its frames, seconds."""
        return [self.recording.timestamp_s(k) for k in range(len(self.recording))]


class RigRecording(Recording):
    """The recordings of several cameras as one; `open_recording` makes it.

    Frame numbers count the frames of all cameras in the order of their times; of equal times, the first camera comes
    first. Attributes that are not listed here are those of the first camera.

    Attributes
    ----------
    kind : {"fixed", "moving"}
    parts : tuple of RigPart
        The cameras.
    """

    def __init__(self, path: Path, rig: RigDocument, recordings: Sequence[Recording]) -> None:
        first = recordings[0]
        self.__dict__.update(first.__dict__)
        self.path, self.format, self.kind = path, FORMAT, rig.kind
        self.registration_checked = all(one.registration_checked for one in recordings)
        self.parts = tuple(
            RigPart(
                RigCamera(entry.name, recording.intrinsics),
                recording.without_poses() if rig.kind == FIXED else recording,
                entry.pose,
            )
            for entry, recording in zip(rig.cameras, recordings, strict=True)
        )
        self._times_s = [part.times_s() for part in self.parts]
        self._order = sorted(
            (time_s, k, j) for k, times_s in enumerate(self._times_s) for j, time_s in enumerate(times_s)
        )
        self.has_timestamps = all(part.recording.has_timestamps for part in self.parts)
        self.up_world = None
        # The camera whose poses move the rig; None if each camera has its own poses, or none.
        posed = [k for k, part in enumerate(self.parts) if part.recording.has_poses]
        self._reference = posed[0] if posed and rig.cameras[0].pose is not None else None
        if posed and self._reference is None and rig.kind != FIXED and len(posed) < len(self.parts):
            name = next(part.camera.name for k, part in enumerate(self.parts) if k not in posed)
            raise InputError(f"{path}: camera '{name}' has no poses; without 'T_rig_camera' each camera needs its own")
        self.has_poses = rig.kind == FIXED or bool(posed)
        self.warnings = (
            *(f"camera {part.camera.name}: {one}" for part in self.parts for one in part.recording.warnings),
            *late_warnings([part.camera.name for part in self.parts], self._times_s),
            *self._sparse_warnings(),
        )

    def _sparse_warnings(self) -> list[str]:
        """Return a warning if the camera that moves the rig has its frames too far apart for poses between them."""
        if self._reference is None or self.kind == FIXED or len(self._times_s[self._reference]) < 2:
            return []
        interval_s = float(np.median(np.diff(self._times_s[self._reference])))
        if interval_s <= MAX_GAP_S:
            return []
        name = self.parts[self._reference].camera.name
        return [
            f"camera {name}, which has the poses of the rig, has a frame each {interval_s:.2f} s; between frames more "
            f"than {MAX_GAP_S:.1f} s apart, those of the other cameras get no pose"
        ]

    def __len__(self) -> int:
        """Return the number of frames of all cameras, bad ones included."""
        return len(self._order)

    def __repr__(self) -> str:
        names = ", ".join(part.camera.name for part in self.parts)
        return f"RigRecording({self.kind}: {len(self)} frames of {len(self.parts)} cameras ({names}); {self.path})"

    @property
    def rig(self) -> Rig:
        """The cameras with their poses in the rig."""
        poses = {part.camera.name: part.T_rig_camera for part in self.parts if part.T_rig_camera is not None}
        return Rig(self.kind, tuple(part.camera for part in self.parts), poses)

    def part_of(self, index: int) -> tuple[RigPart, int]:
        """Return the camera of a frame, and the frame's number in the recording of this camera."""
        _, k, j = self._order[index]
        return self.parts[k], j

    def of(self, name: str) -> Recording:
        """Return the recording of the camera with a name."""
        return next(part.recording for part in self.parts if part.camera.name == name)

    def timestamp_s(self, index: int) -> float:
        """Return the time of a frame in seconds."""
        return self._order[index][0]

    @property
    def up_measured(self) -> bool:
        """Whether up was measured with each frame."""
        return any(part.recording.up_measured for part in self.parts)

    def up_camera(self, index: int) -> Float64Array | None:
        """Return up in the camera of a frame; see `Recording.up_camera`."""
        part, j = self.part_of(index)
        return part.recording.up_camera(j)

    def color_name(self, index: int) -> str | None:
        """Return a frame's color file, relative to the recording of its camera."""
        part, j = self.part_of(index)
        return part.recording.color_name(j)

    def pose(self, index: int) -> Float64Array | None:
        """Return T_world_camera (4, 4) of a frame without decoding it; see `Recording.pose`.

        The world of a fixed rig is the rig. The world of a moving rig is that of its first camera with poses; the pose
        of the rig between two of them is interpolated.
        """
        if not self.has_poses:
            return None
        time_s, k, j = self._order[index]
        part = self.parts[k]
        if self.kind == FIXED:
            return part.T_rig_camera
        if part.T_rig_camera is None or k == self._reference:
            if not part.recording.has_poses:
                raise FrameError("the frame has no camera pose")
            return part.recording.pose(j)
        return np.asarray(self._T_world_rig(time_s) @ part.T_rig_camera)

    def _T_world_rig(self, time_s: float) -> Float64Array:
        """Return the pose of a moving rig at a time; raises FrameError if there are no two posed frames near.

        Before its first frame and after its last one, the reference moves on at constant velocity.
        """
        assert self._reference is not None
        times_s, reference = self._times_s[self._reference], self.parts[self._reference]
        assert reference.T_rig_camera is not None
        j = min(max(bisect.bisect_right(times_s, time_s) - 1, 0), len(times_s) - 1)
        if times_s[j] == time_s:
            return tidied(self._reference_pose(j) @ inverse(reference.T_rig_camera))
        first, last = max(min(j, len(times_s) - 2), 0), min(j + 1, len(times_s) - 1)
        gap_s = times_s[last] - times_s[first]
        outside_s = max(times_s[first] - time_s, time_s - times_s[last])
        if not 0 < gap_s <= MAX_GAP_S or outside_s > MAX_GAP_S:
            raise FrameError(f"camera {reference.camera.name}, which has the poses of the rig, has no frames near")
        T_world_first = self._reference_pose(first)
        motion = log(inverse(T_world_first) @ self._reference_pose(last))
        T = T_world_first @ exp(motion * (time_s - times_s[first]) / gap_s)
        return tidied(T @ inverse(reference.T_rig_camera))

    def _reference_pose(self, j: int) -> Float64Array:
        """Return the pose of a frame of the camera that moves the rig; raises FrameError if it has none."""
        assert self._reference is not None
        T = self.parts[self._reference].recording.pose(j)
        assert T is not None
        return T

    def read(self, index: int) -> Frame:
        """Return one frame, decoded, with its camera; see `Recording.read`."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of a recording with {len(self)} frames")
        part, j = self.part_of(index)
        try:
            T_world_camera = self.pose(index)
            frame = part.recording.without_poses().read(j)
        except FrameError as error:
            raise FrameError(f"camera {part.camera.name}: {error}") from None
        return replace(frame, index=index, T_world_camera=T_world_camera, camera=part.camera)

    def settings(self) -> dict[str, Any]:
        """Return the entry of `run.json`; see `rig_settings`."""
        paths = [str(part.recording.path) for part in self.parts]
        return rig_settings(self.rig, paths, self._times_s, [k for _, k, _ in self._order])

    def thinned(self, every: int) -> list[int]:
        """Return the numbers of each n-th frame of each camera, in order."""
        return [index for index, (_, _, j) in enumerate(self._order) if j % every == 0]


def rig_settings(
    rig: Rig, recordings: Sequence[str], times_s: Sequence[Sequence[float]], sequence: Sequence[int]
) -> dict[str, Any]:
    """Return the entry of a rig in `run.json`: name, lens, recording, frames, time and rate of each camera.

    Parameters
    ----------
    rig : Rig
    recordings : sequence of str
        Paths of the recordings; empty if there are none.
    times_s : sequence of sequences of float
        Times of the frames of each camera; empty for a camera without a frame.
    sequence : sequence of int
        The number of the camera of each frame, in the order of the frames.
    """
    lenses = {
        key: [getattr(camera.intrinsics, key) for camera in rig.cameras]
        for key in ("fx", "fy", "cx", "cy", "width", "height")
    }
    spans = [(times[0], times[-1], len(times)) if times else (0.0, 0.0, 0) for times in times_s]
    return {
        "kind": rig.kind,
        "cameras": [camera.name for camera in rig.cameras],
        **lenses,
        "recordings": list(recordings),
        "frames": [count for _, _, count in spans],
        "first_s": [first_s if count else None for first_s, _, count in spans],
        "last_s": [last_s if count else None for _, last_s, count in spans],
        "frames_per_second": [round(rate(*span), 2) for span in spans],
        "offset_ms": [
            round(1e3 * _offset_s(times, times_s[0]), 2) if times and times_s[0] else None for times in times_s
        ],
        "sequence": list(sequence),
    }


def late_warnings(names: Sequence[str], times_s: Sequence[Sequence[float]]) -> list[str]:
    """Return a warning for each camera that starts late or stops early; each has a frame."""
    first_s, last_s = min(times[0] for times in times_s), max(times[-1] for times in times_s)
    found = []
    for name, times in zip(names, times_s, strict=True):
        if times[0] - first_s > LATE_S:
            found.append(f"camera {name} starts {times[0] - first_s:.1f} s after the first camera")
        if last_s - times[-1] > LATE_S:
            found.append(f"camera {name} stops {last_s - times[-1]:.1f} s before the last camera")
    if max(times[0] for times in times_s) > min(times[-1] for times in times_s):
        found.append("the times of the cameras do not overlap; a rig needs recordings with a common clock")
    return found


def rate(first_s: float, last_s: float, count: int) -> float:
    """Return the frames per second of `count` frames between two times; 0 for one frame."""
    return (count - 1) / (last_s - first_s) if last_s > first_s else 0.0


def _offset_s(times_s: Sequence[float], others_s: Sequence[float]) -> float:
    """Return the median time between a frame and the nearest one of another camera, seconds."""
    own, others = np.array(times_s), np.array(others_s)
    after = np.clip(np.searchsorted(others, own), 1, max(len(others) - 1, 1))
    nearest = np.minimum(np.abs(others[np.minimum(after, len(others) - 1)] - own), np.abs(others[after - 1] - own))
    return float(np.median(nearest))
