"""`run.json`: the report of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from cuboid.ground.core.values import LAST_FRAME, Amount, Entry, FrameNumber, Name, Text, refuse_twice
from cuboid.ground.formats.camera_file import (
    DepthCameraEntry,
    DepthUnits,
    Matrix,
    refuse_half_a_camera,
    refuse_no_lens,
)

Whole = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
Setting = bool | Whole | float | Text | None
Distortion = Annotated[float, Meta(ge=-1e6, le=1e6)]
# Frames that results can speak of: 93 hours at 30 a second.
MAX_FRAMES = 10_000_000


class SkippedEntry(Entry, frozen=True):
    """A frame that could not be used."""

    frame: FrameNumber
    reason: Text


class FramesEntry(Entry, frozen=True):
    """The frames of a run."""

    read: Annotated[int, Meta(ge=0, le=MAX_FRAMES)]
    used: Annotated[int, Meta(ge=0, le=MAX_FRAMES)]
    skipped: list[SkippedEntry]
    dropped: Annotated[
        int, Meta(ge=0, le=MAX_FRAMES, description="frames of a live camera that were dropped; they have no numbers")
    ] = 0

    def __post_init__(self) -> None:
        if self.used + len(self.skipped) != self.read:
            raise ValueError(f"read {self.read} frames, but used {self.used} and skipped {len(self.skipped)} of them")
        refuse_twice("skipped frame", [item.frame for item in self.skipped])


class Timing(Entry, frozen=True):
    """Milliseconds over the used frames."""

    median_ms: Amount = msgspec.field(name="median")
    p95_ms: Amount = msgspec.field(name="p95")

    @classmethod
    def of(cls, milliseconds: Sequence[float]) -> Timing:
        """Return the timing of at least one measurement."""
        median, p95 = np.percentile(milliseconds, (50, 95))
        return cls(float(median), float(p95))


class LimitReached(Entry, frozen=True):
    """Numbers of items beyond a limit per frame; the least likely items are left out."""

    most: Annotated[int, Meta(ge=1, le=1_000_000, description="the limit per frame")]
    frames: Annotated[int, Meta(ge=1, le=MAX_FRAMES, description="number of frames with more items")]
    left_out: Annotated[int, Meta(ge=1, le=2**53, description="items left out in all frames")]


class ConfigEntry(Entry, frozen=True):
    """The settings that readers of results need; others are information."""

    every: Annotated[int, Meta(ge=1, le=LAST_FRAME, description="every n-th frame was used")] = 1
    distortion: Annotated[
        tuple[Distortion, ...],
        Meta(max_length=8, description="coefficients of the lens distortion that was removed from the images"),
    ] = ()
    depth_units_per_metre: Annotated[DepthUnits | None, Meta(description="units of the depth images per metre")] = None
    depth_camera: DepthCameraEntry | None = None
    T_color_depth: Matrix | None = None

    def __post_init__(self) -> None:
        refuse_no_lens(self.distortion)
        refuse_half_a_camera(self.depth_camera, self.T_color_depth)


class RunDocument(Entry, frozen=True):
    """The report of a run: `run.json`."""

    version: Annotated[Name, Meta(description="version of the program")]
    complete: Annotated[bool, Meta(description="false if the run was interrupted")]
    recording: Annotated[str, Meta(max_length=5000, description="path or URL of the recording")]
    format: Annotated[Name, Meta(description="layout of the recording")]
    poses: Literal["given", "corrected", "estimated"]
    threads: Annotated[int, Meta(ge=1, le=100_000)]
    config: Annotated[
        dict[str, Setting | list[Setting | list[Setting]] | dict[str, Setting | list[Setting]]],
        Meta(description="the settings in use, among them `every`, `distortion`, `depth_units_per_metre`"),
    ]
    frames: FramesEntry
    milliseconds: Annotated[
        dict[Name, Timing], Meta(description="'frame' is the whole work on a frame; the stages follow in their order")
    ]
    seconds: Annotated[Amount, Meta(description="duration of the whole run")]
    peak_memory_mb: Amount
    warnings: Annotated[tuple[Text, ...], Meta(description="likely faults of the input")] = ()
    limits: Annotated[
        dict[Name, LimitReached],
        Meta(description="'proposals', 'clusters', 'candidates': limits that some frames exceeded; mostly empty"),
    ] = {}  # noqa: RUF012  # msgspec copies it

    def __post_init__(self) -> None:
        read, every = self.frames.read, self.settings.every
        if read * every > LAST_FRAME:
            raise ValueError(f"{read} frames, each {every}-th one of the recording, are more than any recording has")
        if "rig" in self.config:  # of a rig, each camera has its own n-th frames
            return
        strange = [item.frame for item in self.frames.skipped if item.frame not in range(0, read * every, every)]
        if strange:
            raise ValueError(f"skipped frame {strange[0]} is none of the {read} frames read, each {every}-th one")

    @property
    def settings(self) -> ConfigEntry:
        """The settings that readers of results need."""
        try:
            return msgspec.convert(self.config, ConfigEntry)
        except msgspec.ValidationError as error:
            raise ValueError(f"config: {error}") from None
