"""A recording: frames are decoded on request, never all at once."""

from __future__ import annotations

import copy
import dataclasses
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, Intrinsics, SkippedFrame, unit
from cuboid.ground.core.pose_convention import converted
from cuboid.ground.core.pose_stream import PoseStream
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import calibration as calibrations
from cuboid.inputs.readers.depth_camera import DepthCamera
from cuboid.inputs.readers.images import decode_color, decode_depth, depth_in_metres
from cuboid.inputs.readers.prefetch import run_ahead
from cuboid.inputs.readers.reader import Calibration, FrameEntry, ImageSource, Listing
from cuboid.inputs.readers.undistortion import DepthArray

# Default frame rate of recordings without timestamps: all common depth cameras run at 30 Hz.
DEFAULT_RATE_HZ = 30.0
# Number of first decodable frames whose most frequent image size is the recording's.
SIZE_VOTERS = 5
# Number of frames decoded ahead: one in work and one ready hide the decoding time; each takes 2 MB at 640x480.
FRAMES_AHEAD = 2
# glibc gives freed blocks back to the kernel and faults them in anew at the next frame, page by page (1 ms a
# frame), until it has seen a block of this size freed (its limit is 32 MB); then it keeps them.
LARGE_BLOCK_BYTES = 31 << 20


@dataclass(frozen=True, slots=True)
class PoseClock:
    """The clock of given poses.

    Attributes
    ----------
    added_s : float
        Added to the times of the poses, seconds.
    found_s, error_s : float or None
        The offset that the images show, and half of its 95 % interval; None if it was not measured.
    doubt : str
        Why a measured offset is not applied, in a few words.
    misfit : str
        A warning that the poses do not fit the frames for another reason; empty if they fit.
    """

    added_s: float = 0.0
    found_s: float | None = None
    error_s: float | None = None
    doubt: str = ""
    misfit: str = ""

    def settings(self) -> dict[str, Any]:
        """Return the entry of `run.json`; empty if the offset was neither measured nor given."""
        if self.found_s is None or self.error_s is None:
            return {"pose_offset": {"added_ms": round(1e3 * self.added_s, 2)}} if self.added_s else {}
        found = {"found_ms": round(1e3 * self.found_s, 2), "error_ms": round(1e3 * self.error_s, 2)}
        return {"pose_offset": {"added_ms": round(1e3 * self.added_s, 2), **found, "doubt": self.doubt}}


class Recording:
    """An RGB-D recording; `cuboid.open_recording` makes it.

    Attributes
    ----------
    format : str
        Name of the reader.
    path : Path
        What holds the frames.
    intrinsics : Intrinsics
        Intrinsics of the frames, which are undistorted (if the distortion is known) and have depth aligned to color.
    calibration : Calibration
        The camera of the recording, and the source of its parameters.
    depth_units_per_metre : float
    has_poses : bool
        Whether frames have camera poses; frames without one are then skipped.
    has_timestamps : bool
        Whether the recording has timestamps; otherwise times are index / 30 s.
    up_world : (3,) float64 or None
        Up (opposite to gravity), a unit vector in the world of the poses, if the recording has it; `up_camera` has the
        measurement of each frame.
    warnings : tuple of str
        Warnings for the user about the files, one line each: images left out, images paired by order.
    registration_checked : bool
        Whether some of its frames were searched for depth that is displaced from color.
    pose_clock : PoseClock
        What is known of the offset between the times of poses and frames, and what is added to the former.
    """

    registration_checked = False
    pose_clock = PoseClock()

    def __init__(
        self,
        path: Path,
        format: str,  # noqa: A002 - the public name of the attribute
        listing: Listing,
        calibration: Calibration,
        depth_units_per_metre: float,
    ) -> None:
        self.path = path
        self.format = format
        self.calibration = calibration
        self.depth_units_per_metre = depth_units_per_metre
        self._frames: Sequence[FrameEntry] = listing.frames
        self.warnings = listing.warnings
        self.has_poses = any(entry.pose is not None for entry in listing.frames)
        self.has_timestamps = all(entry.timestamp_s is not None for entry in listing.frames)
        np.empty(LARGE_BLOCK_BYTES, np.uint8)  # freed at once, never touched: see above
        width, height = self._vote_on_size()
        self.intrinsics: Intrinsics = calibrations.for_size(calibration, width, height, path)
        self._undistort = calibrations.undistortion(calibration, (width, height), path)
        self._poses_of_depth = listing.poses_of_depth
        self._pose_convention: tuple[str, ...] = ()
        self._pose_stream: PoseStream | None = None
        self._set_camera(calibration)
        self.up_world: Float64Array | None = None
        if self.has_poses and listing.up_world is not None:
            self.up_world = unit(listing.up_world)

    def _set_camera(self, calibration: Calibration) -> None:
        """Set the camera of the frames, and its depth camera, if it has one."""
        self.calibration = calibration
        self._register = calibrations.registration(calibration, self.intrinsics, self.path)
        depth_camera = calibration.depth_camera
        self._T_depth_color: Float64Array | None = None
        if depth_camera is not None and self._poses_of_depth:
            self._T_depth_color = se3.inverse(depth_camera.T_color_depth)

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients of the lens distortion, which is removed from the frames; empty if there is none."""
        return self.calibration.distortion if any(self.calibration.distortion) else ()

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The depth camera whose images were registered to color; None if depth was already aligned."""
        return self.calibration.depth_camera

    def __len__(self) -> int:
        """Return the number of frames, bad ones included."""
        return len(self._frames)

    def __getitem__(self, index: int) -> Frame:
        """Return one frame; negative numbers count from the end; raises as `read` does."""
        if not isinstance(index, int):
            raise TypeError(f"a recording has frames by number, got {index!r}; iterate(every, limit) gives several")
        return self.read(index + len(self) if index < 0 else index)

    def __iter__(self) -> Iterator[Frame | SkippedFrame]:
        """Iterate over all frames in order, as `iterate` does."""
        return self.iterate()

    def __repr__(self) -> str:
        K = self.intrinsics
        poses = "with poses" if self.has_poses else "no poses"
        return f"Recording({self.format}: {len(self)} frames of {K.width} x {K.height}, {poses}; {self.path})"

    def _with(self, **changes: Any) -> Self:
        """Return the same recording with some attributes changed."""
        other = copy.copy(self)
        other.__dict__.update(changes)
        return other

    def without_poses(self) -> Self:
        """Return the same recording without its camera poses and their faults."""
        return self._with(has_poses=False, up_world=None)

    def with_intrinsics(self, intrinsics: Intrinsics) -> Self:
        """Return the same recording with other intrinsics; the images are unchanged."""
        return self._with(intrinsics=intrinsics)

    def with_depth_camera(self, depth_camera: DepthCamera) -> Self:
        """Return the same recording with depth registered to color from this camera.

        Raises
        ------
        InputError
            The depth camera is invalid.
        """
        other = self._with()
        other._set_camera(dataclasses.replace(self.calibration, depth_camera=depth_camera))
        return other

    def with_pose_convention(self, names: tuple[str, ...]) -> Self:
        """Return the same recording with its poses in these conventions, see `pose_convention.CONVENTIONS`."""
        return self._with(_pose_convention=names)

    def with_pose_clock(self, clock: PoseClock) -> Self:
        """Return the same recording with poses whose times are corrected."""
        return self._with(pose_clock=clock)

    def with_warning(self, warning: str) -> Self:
        """Return the same recording with one more line in `warnings`."""
        return self._with(warnings=(*self.warnings, warning))

    def timestamp_s(self, index: int) -> float:
        """Return the time of a frame in seconds."""
        time_s = self._frames[index].timestamp_s
        return index / DEFAULT_RATE_HZ if time_s is None else time_s

    def pose(self, index: int) -> Float64Array | None:
        """Return T_world_camera (4, 4) of a frame without decoding it; None where the recording has no poses.

        Raises
        ------
        FrameError
            If the recording has poses but this frame has none, or one that is not rigid.
        """
        if not self.has_poses:
            return None
        T = self._pose_as_read(index, -self.pose_clock.added_s)
        return T if self._T_depth_color is None else T @ self._T_depth_color

    def _pose_as_read(self, index: int, after_s: float = 0.0) -> Float64Array:
        """Return the pose of a frame, or of a time after it, in our convention; raises as `pose` does."""
        entry = self._frames[index]
        if entry.pose is None:
            raise FrameError("the frame has no camera pose")
        try:
            if after_s == 0.0:
                return converted(se3.rigid(entry.pose()), self._pose_convention)
            if entry.pose_after is not None:
                return converted(se3.rigid(entry.pose_after(after_s)), self._pose_convention)
        except ValueError as error:  # of a reader that does not look at its poses
            raise FrameError(str(error)) from None
        if self._pose_stream is None:
            self._pose_stream = self._poses_of_frames()
        return self._pose_stream.at(self.timestamp_s(index) + after_s)

    def _poses_of_frames(self) -> PoseStream:
        """Return the poses of all frames that have one, by time."""
        found: dict[float, Float64Array] = {}
        for index in range(len(self)):
            with suppress(FrameError):
                found.setdefault(self.timestamp_s(index), self._pose_as_read(index))
        return PoseStream("the recording", np.array(sorted(found)), [found[time_s] for time_s in sorted(found)])

    @property
    def up_measured(self) -> bool:
        """Whether up was measured with each frame."""
        return any(entry.up_camera is not None for entry in self._frames)

    def up_camera(self, index: int) -> Float64Array | None:
        """Return up (opposite to gravity) in the camera of a frame, without decoding the frame.

        Parameters
        ----------
        index : int

        Returns
        -------
        (3,) float64 or None
            Unit vector in camera coordinates (x right, y down, z forward): measured with the frame, else from the
            frame's pose; None if the recording has neither.

        Raises
        ------
        FrameError
            Up cannot be read for this frame.
        """
        measured = self._frames[index].up_camera is not None
        return self._up_in(index, None if measured or self.up_world is None else self.pose(index))

    def _up_in(self, index: int, T_world_camera: Float64Array | None) -> Float64Array | None:
        """Return `up_camera` of a frame whose pose is known."""
        measured = self._frames[index].up_camera
        if measured is not None:
            return unit(measured())
        return None if T_world_camera is None or self.up_world is None else T_world_camera[:3, :3].T @ self.up_world

    def _up_if_told(self, index: int, T_world_camera: Float64Array | None) -> Float64Array | None:
        """Return up in the camera, or None if it is unknown: the frame's images remain usable."""
        try:
            return self._up_in(index, T_world_camera)
        except FrameError:
            return None

    def color_name(self, index: int) -> str | None:
        """Return a frame's color file, relative to the recording; None if it has no separate file."""
        color = self._frames[index].color
        return self._name(color) if isinstance(color, Path) else None

    def read(self, index: int) -> Frame:
        """Return one frame, decoded.

        Parameters
        ----------
        index : int
            0 to len - 1.

        Raises
        ------
        FrameError
            With the reason, one line, if the frame cannot be used.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of a recording with {len(self)} frames")
        T_world_camera = self.pose(index)  # first, because it is the cheapest
        color, raw, depth_name = self._decode(self._frames[index])
        expected = (self.intrinsics.height, self.intrinsics.width)
        if color.shape[:2] != expected:
            raise FrameError(f"the frame is {_size(color)}, the recording {_size(np.empty(expected))}: {depth_name}")
        color = self._undistort.color(color)
        if self._register is None:
            depth_m = depth_in_metres(self._undistort.depth(raw), self.depth_units_per_metre, depth_name)
        else:
            depth_m = self._register(depth_in_metres(raw, self.depth_units_per_metre, depth_name), depth_name)
        up_camera = self._up_if_told(index, T_world_camera)
        return Frame(index, self.timestamp_s(index), color, depth_m, T_world_camera, up_camera)

    def iterate(
        self, every: int = 1, limit: int | None = None, prefetch: bool = True
    ) -> Generator[Frame | SkippedFrame, None, None]:
        """Iterate over frames in order; bad ones come as `SkippedFrame`.

        Parameters
        ----------
        every : int
            Use every n-th frame, from frame 0.
        limit : int or None
            At most this many frames, skipped ones included.
        prefetch : bool
            Whether to decode the next frames in a separate thread.
        """
        if every < 1 or (limit is not None and limit < 0):
            raise ValueError(f"every must be at least 1 and limit at least 0, got {every} and {limit}")
        indices = range(0, len(self), every)[:limit]
        decoded = (self._read_or_skip(index) for index in indices)
        if prefetch:
            yield from run_ahead(decoded, FRAMES_AHEAD)
        else:
            yield from decoded

    def _read_or_skip(self, index: int) -> Frame | SkippedFrame:
        try:
            return self.read(index)
        except FrameError as error:
            return SkippedFrame(index, str(error))

    def _decode(self, entry: FrameEntry) -> tuple[UInt8Array, DepthArray, str]:
        """Return color, stored depth and its name; raise FrameError unless both exist in the expected sizes."""
        if entry.fault is not None:
            raise FrameError(entry.fault)
        if entry.color is None or entry.depth is None:
            there, lacking = ("color", "depth") if entry.depth is None else ("depth", "color")
            source = entry.color if entry.depth is None else entry.depth
            raise FrameError(f"{there} without {lacking}: {self._name(source)}")
        color_name, depth_name = self._name(entry.color), self._name(entry.depth)
        color, raw = decode_color(entry.color, color_name), decode_depth(entry.depth, depth_name)
        if self.calibration.depth_camera is not None:
            width, height = self.calibration.depth_camera.size
            if raw.shape != (height, width):
                raise FrameError(f"depth is {_size(raw)}, its camera {width}x{height}: {depth_name}")
        elif color.shape[:2] != raw.shape:
            raise FrameError(
                f"color is {_size(color)} but depth {_size(raw)}, they must be aligned, or camera.json must describe "
                f"the 'depth_camera': {color_name}, {depth_name}"
            )
        return color, raw, depth_name

    def _vote_on_size(self) -> tuple[int, int]:
        """Return (width, height) that most of the first decodable frames have."""
        shapes: Counter[tuple[int, ...]] = Counter()
        first_fault = ""
        for entry in self._frames:
            try:
                shapes[self._decode(entry)[0].shape[:2]] += 1
            except FrameError as error:
                first_fault = first_fault or str(error)
            if shapes.total() == SIZE_VOTERS:
                break
        if not shapes:
            raise InputError(f"{self.path}: none of its {len(self)} frames can be used; the first: {first_fault}")
        height, width = shapes.most_common(1)[0][0]  # of equals the one that came first
        return width, height

    def _name(self, source: ImageSource | None) -> str:
        """Return a file's name relative to the recording."""
        if not isinstance(source, Path):
            return "(in the recording's file)"
        return str(source.relative_to(self.path)) if source.is_relative_to(self.path) else str(source)


def _size(image: npt.NDArray[np.generic]) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
