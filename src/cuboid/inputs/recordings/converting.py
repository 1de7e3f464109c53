"""Conversion of any readable recording to a plain folder, the TUM format, or a ROS 2 bag.

The frames are written as the tracker would get them: without distortion, with depth registered to color, and with poses
of the color camera. Color and depth are kept without loss, with one exception: depth in folders is rounded to a fifth
of a millimetre if it was registered to color, and always in the TUM format.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, Self

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.errors import FrameError, InputError, OutputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.folder import ResultFolder, writing
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import Recording
from cuboid.inputs.readers.calibration import CAMERA_FILE, write_camera
from cuboid.inputs.readers.depth_camera import DepthCamera

# Units per metre of depth that has no integer values in the recording's units: a fifth of a millimetre, up to 13 m.
CARRIED_UNITS = 5000.0
# Minimum units per metre of depth in integers; with fewer, depth is in fractions.
MIN_INTEGER_UNITS = 100.0
TUM_UNITS = 5000.0
# PNG compression level: a few percent larger than the best, in a tenth of the time.
PNG_EFFORT = 1
SATURATED = 65535
# This file marks a folder that a conversion wrote; only such a folder is replaced.
MARK = ".converted"


class RecordingWriter(Protocol):
    """A writer of one format; `finish` is called after the last frame."""

    def add(self, frame: Frame) -> None:
        """Write a frame."""

    def finish(self) -> None:
        """Write the files that cover all frames."""

    def __enter__(self) -> Self:
        """Return the writer."""

    def __exit__(self, *error: object) -> None:
        """Close open files."""


class PlainWriter:
    """Writer of the plain folder (docs/recordings.md): images named by the frame's number in the recording."""

    color, poses, key = "color", "poses.txt", "number"

    def __init__(
        self, folder: Path, intrinsics: Intrinsics, units_per_metre: float, up_world: Float64Array | None = None
    ) -> None:
        self._folder = folder
        self._intrinsics = intrinsics
        self._units = units_per_metre
        self._up_world = up_world
        # The key, the time in seconds and the pose of each frame.
        self._frames: list[tuple[str, float, Float64Array | None]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def add(self, frame: Frame) -> None:
        """Write color and depth."""
        key, name = self._named(frame)
        for kind, image in ((self.color, frame.color[..., ::-1]), ("depth", as_units(frame.depth_m, self._units))):
            (self._folder / kind).mkdir(exist_ok=True)
            (self._folder / kind / f"{name}.png").write_bytes(png(image))
        self._frames.append((key, frame.timestamp_s, frame.T_world_camera))

    def finish(self) -> None:
        """Write the camera, the times and the poses."""
        write_camera(self._folder / CAMERA_FILE, self._intrinsics, self._units, up_world=self._up_world)
        self._write_times()
        poses = [f"{key} {pose_text(T)}" for key, _, T in self._frames if T is not None]
        if poses:
            self._write(self.poses, [f"# {self.key} tx ty tz qx qy qz qw", *poses])

    def _named(self, frame: Frame) -> tuple[str, str]:
        """Return the key of a frame in text files, and the name of its images."""
        return str(frame.index), f"{frame.index:06d}"

    def _write_times(self) -> None:
        self._write("timestamps.txt", [f"{key} {time_s:.6f}" for key, time_s, _ in self._frames])

    def _write(self, name: str, lines: Sequence[str]) -> None:
        text = "".join(line + "\n" for line in lines)
        (self._folder / name).write_text(text, encoding="utf-8", newline="\n")


class TumWriter(PlainWriter):
    """Writer of the TUM RGB-D format, with an additional `camera.json`; images are named by their time."""

    color, poses, key = "rgb", "groundtruth.txt", "timestamp"

    def _named(self, frame: Frame) -> tuple[str, str]:
        return (f"{frame.timestamp_s:.6f}",) * 2

    def _write_times(self) -> None:
        for kind in ("rgb", "depth"):
            lines = [f"{key} {kind}/{key}.png" for key, _, _ in self._frames]
            self._write(f"{kind}.txt", ["# timestamp filename", *lines])


def _mcap_writer(
    folder: Path, intrinsics: Intrinsics, units_per_metre: float, up_world: Float64Array | None = None
) -> RecordingWriter:
    from cuboid.ground.formats.mcap_writing import McapWriter

    return McapWriter(folder, intrinsics, units_per_metre)


WRITERS: dict[str, Callable[[Path, Intrinsics, float, Float64Array | None], RecordingWriter]] = {
    "plain": PlainWriter,
    "tum": lambda folder, intrinsics, _, up_world: TumWriter(folder, intrinsics, TUM_UNITS, up_world),
    "mcap": _mcap_writer,
}


def convert_recording(
    recording: Recording,
    output: PathLike,
    form: str,
    frames: range,
    *,
    force: bool = False,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> dict[int, str]:
    """Write frames of a recording in another format.

    Parameters
    ----------
    recording : Recording
    output : path
        Folder, which appears when it is complete.
    form : str
        One of `WRITERS`.
    frames : range
        Numbers of the frames.
    force : bool
        Whether the folder of an earlier conversion is replaced when the new one is complete.
    progress : callable
        Called with the number of finished frames and the total number.

    Returns
    -------
    dict of int to str
        Frames that were left out, with the reason.

    Raises
    ------
    InputError
        No frame can be used.
    OutputError
        The folder exists and `force` is False, or no conversion wrote it; or it cannot be written.
    """
    output, skipped = as_path(output), dict[int, str]()
    units = units_kept(recording.depth_units_per_metre, recording.depth_camera)
    with _replacing(output, force=force) as place, ResultFolder(place) as folder, writing(output):
        work = folder.file("")
        with WRITERS[form](work, recording.intrinsics, units, recording.up_world) as writer:
            for done, index in enumerate(frames):
                frame = _read(recording, index, skipped)
                if frame is not None:
                    writer.add(frame)
                progress(done + 1, len(frames))
            if len(skipped) == len(frames):
                first = next(iter(skipped.items()), (0, "there are none"))
                raise InputError(f"{recording.path}: no frame can be converted; frame {first[0]}: {first[1]}")
            writer.finish()
        (work / MARK).touch()
        folder.commit()
    return skipped


@contextmanager
def _replacing(output: Path, *, force: bool) -> Iterator[Path]:
    """Yield the folder to write: the output, or a temporary one that then replaces an earlier conversion."""
    if not (force and output.exists()):
        yield output
        return
    if not (output / MARK).is_file():
        raise OutputError(f"{output}: exists and was not written by 'cuboid convert'; name another folder")
    beside = output.with_name(f".{output.name}.new")
    with writing(output):
        shutil.rmtree(beside, ignore_errors=True)  # left by a killed conversion
        yield beside
        shutil.rmtree(output)
        beside.rename(output)


def _read(recording: Recording, index: int, skipped: dict[int, str]) -> Frame | None:
    """Return a frame, without a pose if only that is unusable; None, with the reason noted, if it cannot be read."""
    try:
        return recording.read(index)
    except FrameError as error:
        skipped[index] = str(error)
    if recording.has_poses:
        try:
            frame = recording.without_poses().read(index)
        except FrameError:
            return None
        del skipped[index]
        return frame
    return None


def units_kept(units_per_metre: float, depth_camera: DepthCamera | None) -> float:
    """Return the units per metre for writing depth: the recording's own if depth still has integer values in them."""
    return units_per_metre if depth_camera is None and units_per_metre >= MIN_INTEGER_UNITS else CARRIED_UNITS


def as_units(depth_m: Float32Array, units_per_metre: float) -> npt.NDArray[np.uint16]:
    """Return depth as 16-bit numbers; 0 where there is no reading or it is out of range."""
    units = np.rint(depth_m * np.float32(units_per_metre))
    return np.where(units < SATURATED, units, 0).astype(np.uint16)


def png(image: UInt8Array | npt.NDArray[np.uint16]) -> bytes:
    """Return an image as PNG."""
    done, data = cv2.imencode(".png", np.ascontiguousarray(image), [cv2.IMWRITE_PNG_COMPRESSION, PNG_EFFORT])
    if not done:
        raise RuntimeError("OpenCV cannot write PNG")
    return data.tobytes()


def pose_text(T_world_camera: Float64Array) -> str:
    """Return a pose as tx ty tz qx qy qz qw."""
    w, x, y, z = se3.quat_wxyz_from_rotation(T_world_camera[:3, :3])
    return " ".join(f"{value:.9f}" for value in (*T_world_camera[:3, 3], x, y, z, w))
