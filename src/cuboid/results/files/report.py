"""`run.json`: the report of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from cuboid.ground.core.frame import Intrinsics, RigCamera
from cuboid.ground.core.skipped import SkippedKind, skipped_kinds
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.run_file import ConfigEntry, LimitReached, RunDocument, Timing
from cuboid.inputs.readers.depth_camera import DepthCamera, depth_camera_of
from cuboid.results.files.objects import write_json
from cuboid.results.files.text import rounded

IntArray = npt.NDArray[np.int64]

# Digits after the point of times in milliseconds: the resolution of the clocks.
MILLISECOND = 3
# Fields of the report that the file has under the same names, in its order.
SAME = ("version", "complete", "recording", "format", "poses", "threads", "config")


@dataclass(frozen=True)
class RunReport:
    """The contents of `run.json`.

    Attributes
    ----------
    version : str
        Of the program.
    complete : bool
        False if the run was interrupted.
    recording : str
        Path of the recording.
    format : str
        Name of the recording's layout.
    poses : str
        "given" or "estimated".
    threads : int
    config : mapping
        The effective configuration.
    frames_read, frames_used : int
    skipped : tuple of (int, str)
        Frame and reason.
    milliseconds : mapping of str to Timing
        Times by stage: "frame" is a whole used frame, decoding included; then the stages in processing order.
    seconds : float
        Duration of the whole run.
    peak_memory_mb : float
        Peak memory of the process, in units of 2**20 bytes.
    warnings : tuple of str
        Probable faults of the input, one line each.
    limits : mapping of str to LimitReached
        Limits that some frames reached, by name.
    frames_dropped : int
        Number of frames of a live camera that the program did not take in time; they have no frame numbers.
    """

    version: str
    complete: bool
    recording: str
    format: str
    poses: str
    threads: int
    config: Mapping[str, Any]
    frames_read: int
    frames_used: int
    skipped: tuple[tuple[int, str], ...]
    milliseconds: Mapping[str, Timing]
    seconds: float
    peak_memory_mb: float
    warnings: tuple[str, ...] = ()
    limits: Mapping[str, LimitReached] = field(default_factory=dict)
    frames_dropped: int = 0

    def __repr__(self) -> str:
        frames = f"{self.frames_used} of {self.frames_read} frames used in {self.seconds:.1f} s"
        return f"RunReport({self.recording}: {frames}; {len(self.warnings)} warnings)"

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients of the lens distortion that was removed from the images; empty if there was none."""
        return tuple(float(value) for value in self.config.get("distortion", ()))

    @property
    def depth_units_per_metre(self) -> float | None:
        """Units of the depth images per metre; None if the results do not contain it."""
        units = self.config.get("depth_units_per_metre")
        return None if units is None else float(units)

    @property
    def depth_camera(self) -> DepthCamera | None:
        """The depth camera whose images were registered to color; None if depth was aligned already."""
        return depth_camera_of(msgspec.convert(self.config, ConfigEntry))

    @property
    def rig_recordings(self) -> tuple[str, ...]:
        """Paths of the recordings of a rig's cameras; empty without a rig."""
        return tuple(self.config.get("rig", {}).get("recordings", ()))

    @property
    def every(self) -> int:
        """Every n-th frame of the recording, or of each camera of a rig, was used."""
        return int(self.config.get("every", 1))

    @cached_property
    def rig_cameras(self) -> tuple[RigCamera, ...]:
        """The cameras of a rig; empty without a rig."""
        rig = self.config.get("rig", {})
        lenses = (rig.get(key, ()) for key in ("fx", "fy", "cx", "cy", "width", "height"))
        pinholes = [Intrinsics(*values) for values in zip(*lenses, strict=True)]
        return tuple(map(RigCamera, rig.get("cameras", ()), pinholes))

    @cached_property
    def rig_frames(self) -> tuple[IntArray, IntArray]:
        """For each frame of a rig: the number of its camera, and its number among the frames of this camera."""
        return rig_frames(self.config)

    def camera_of(self, frame: int) -> RigCamera | None:
        """Return the camera that took a frame; None without a rig, or if that is not known."""
        cameras, _ = self.rig_frames
        return self.rig_cameras[cameras[frame]] if frame < len(cameras) else None

    def used(self) -> IntArray:
        """Return the frames of the recording that were used, (N,) int64, ascending."""
        read = np.arange(0, self.frames_read * self.every, self.every)
        if len(self.rig_frames[1]):
            read = np.flatnonzero(self.rig_frames[1] % self.every == 0)[: self.frames_read]
        return read[~np.isin(read, [frame for frame, _ in self.skipped])]

    def skipped_kinds(self) -> list[SkippedKind]:
        """Return the kinds of bad frames, the most frequent first.

        Reasons that differ only in words with digits (file names, numbers, sizes) are one kind.
        """
        return skipped_kinds(self.skipped)

    def to_dict(self) -> dict[str, Any]:
        """Return the contents of `run.json`."""
        return {
            **{name: getattr(self, name) for name in SAME},
            # a path may contain bytes that are no characters; JSON has only characters
            "recording": self.recording.encode("utf-8", "backslashreplace").decode("utf-8"),
            "frames": {
                "read": self.frames_read,
                "used": self.frames_used,
                "skipped": [{"frame": frame, "reason": reason} for frame, reason in self.skipped],
                **({"dropped": self.frames_dropped} if self.frames_dropped else {}),
            },
            "milliseconds": {
                stage: {name: rounded(value, MILLISECOND) for name, value in msgspec.to_builtins(timing).items()}
                for stage, timing in self.milliseconds.items()
            },
            "seconds": rounded(self.seconds, 3),
            "peak_memory_mb": rounded(self.peak_memory_mb, 1),
            "warnings": list(self.warnings),
            "limits": msgspec.to_builtins(dict(self.limits)),
        }


def rig_frames(config: Mapping[str, Any]) -> tuple[IntArray, IntArray]:
    """Return the frames of a rig as `RunReport.rig_frames` has them, from the settings of a run."""
    cameras = np.array(config.get("rig", {}).get("sequence", ()), np.int64)
    numbers = np.zeros(len(cameras), np.int64)
    for k in np.unique(cameras):
        numbers[cameras == k] = np.arange(np.count_nonzero(cameras == k))
    return cameras, numbers


def write_run(path: Path, report: RunReport) -> None:
    """Write `run.json`.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    write_json(path, report.to_dict())


def read_run(path: Path) -> RunReport:
    """Read `run.json`.

    Raises
    ------
    InputError
        The file is missing, is not JSON, or a field of it is malformed.
    """
    document = read_json(path, RunDocument)
    return RunReport(
        **{name: getattr(document, name) for name in (*SAME, "milliseconds", "seconds", "peak_memory_mb", "warnings")},
        frames_read=document.frames.read,
        frames_used=document.frames.used,
        skipped=tuple((item.frame, item.reason) for item in document.frames.skipped),
        limits=document.limits,
        frames_dropped=document.frames.dropped,
    )
