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
from cuboid.ground.core.frame import Frame, RigCamera
from cuboid.ground.formats import rig_file
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.rig_file import FIXED, RigDocument
from cuboid.ground.geometry.se3 import interpolate, inverse, tidied
from cuboid.inputs.readers import Recording

RIG_FILE, FORMAT = "rig.json", "rig"
# A camera that starts later or ends earlier than the others by more than this is named in a warning, seconds.
LATE_S = 1.0
# A frame of a moving rig has no pose if the nearest posed frame is farther away in time than this, seconds: in 0.1 s a
# hand-held camera changes its velocity.
MAX_GAP_S = 0.1


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
        self.has_poses = rig.kind == FIXED or bool(posed)
        self.warnings = (
            *(f"camera {part.camera.name}: {one}" for part in self.parts for one in part.recording.warnings),
            *self._late(),
        )

    def __len__(self) -> int:
        """Return the number of frames of all cameras, bad ones included."""
        return len(self._order)

    def __repr__(self) -> str:
        names = ", ".join(part.camera.name for part in self.parts)
        return f"RigRecording({self.kind}: {len(self)} frames of {len(self.parts)} cameras ({names}); {self.path})"

    @property
    def T_rig_camera(self) -> dict[str, Float64Array]:
        """Pose of each camera in the rig, by name; empty if each recording has its own poses."""
        return {part.camera.name: part.T_rig_camera for part in self.parts if part.T_rig_camera is not None}

    def part_of(self, index: int) -> tuple[RigPart, int]:
        """Return the camera of a frame, and the frame's number in the recording of this camera."""
        _, k, j = self._order[index]
        return self.parts[k], j

    def of(self, name: str) -> Recording:
        """Return the recording of the camera with a name."""
        return next(part.recording for part in self.parts if part.camera.name == name)

    def without_poses(self) -> RigRecording:
        """Return the same recording without its camera poses; the poses of the cameras in the rig remain known."""
        bare = object.__new__(RigRecording)
        bare.__dict__.update(self.__dict__)
        bare.has_poses = False
        return bare

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
        """Return the pose of a moving rig at a time; raises FrameError if no posed frame is near."""
        assert self._reference is not None
        times_s, reference = self._times_s[self._reference], self.parts[self._reference]
        assert reference.T_rig_camera is not None
        after = bisect.bisect_left(times_s, time_s)
        near = [j for j in (after - 1, after) if 0 <= j < len(times_s) and abs(times_s[j] - time_s) <= MAX_GAP_S]
        if not near:
            raise FrameError(f"camera {reference.camera.name}, which has the poses of the rig, has no frame near")
        poses = [reference.recording.pose(j) for j in near]
        if len(near) == 1 or times_s[near[1]] == time_s:
            T = poses[-1]
        else:
            first_s, last_s = times_s[near[0]], times_s[near[1]]
            assert poses[0] is not None
            assert poses[1] is not None
            T = interpolate(poses[0], poses[1], (time_s - first_s) / (last_s - first_s))
        assert T is not None
        return tidied(T @ inverse(reference.T_rig_camera))

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
        """Return the entry of `run.json`: name, recording, frames, time and rate of each camera."""
        spans = [(times_s[0], times_s[-1], len(times_s)) for times_s in self._times_s]
        return {
            "kind": self.kind,
            "cameras": [part.camera.name for part in self.parts],
            "recordings": [str(part.recording.path) for part in self.parts],
            "frames": [count for _, _, count in spans],
            "first_s": [first_s for first_s, _, _ in spans],
            "last_s": [last_s for _, last_s, _ in spans],
            "frames_per_second": [round(rate(*span), 2) for span in spans],
            "offset_ms": [round(1e3 * _offset_s(times_s, self._times_s[0]), 2) for times_s in self._times_s],
        }

    def _late(self) -> list[str]:
        """Return a warning for each camera that starts late or stops early."""
        first_s, last_s = min(t[0] for t in self._times_s), max(t[-1] for t in self._times_s)
        found = []
        for part, times_s in zip(self.parts, self._times_s, strict=True):
            name = part.camera.name
            if times_s[0] - first_s > LATE_S:
                found.append(f"camera {name} starts {times_s[0] - first_s:.1f} s after the first camera")
            if last_s - times_s[-1] > LATE_S:
                found.append(f"camera {name} stops {last_s - times_s[-1]:.1f} s before the last camera")
        if max(t[0] for t in self._times_s) > min(t[-1] for t in self._times_s):
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
