"""`rig.json`: the cameras of a rig, with their recordings and their poses."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.values import Entry, Metres
from cuboid.ground.geometry.se3 import rigid

FORMAT: Literal["cuboid-rig"] = "cuboid-rig"
VERSION: Literal[1] = 1
FIXED, MOVING = "fixed", "moving"
MAX_CAMERAS = 64

# A name is a cell of `tracks.csv`, and a word of messages.
MAX_NAME, NAME_PATTERN = 50, r'^[^,"\x00-\x1f]+$'
CameraName = Annotated[str, Meta(min_length=1, max_length=MAX_NAME, pattern=NAME_PATTERN)]
RecordingPath = Annotated[str, Meta(max_length=5000)]
MatrixRow = tuple[Metres, Metres, Metres, Metres]
RigidMatrix = tuple[MatrixRow, MatrixRow, MatrixRow, MatrixRow]


class RigCameraEntry(Entry, frozen=True, forbid_unknown_fields=True):
    """A camera of a rig: its recording, and its pose in the rig."""

    name: Annotated[CameraName, Meta(description="name of the camera")]
    recording: Annotated[
        RecordingPath | None, Meta(description="path of its recording, relative to the folder of the file")
    ] = None
    serial: Annotated[
        CameraName | None,
        Meta(description="device of the live camera: serial number, id (OAK, Record3D) or color topic (ROS 2)"),
    ] = None
    T_rig_camera: Annotated[
        RigidMatrix | None,
        Meta(description="camera to rig, metres; left out for all cameras if each recording has poses in one world"),
    ] = None

    def __post_init__(self) -> None:
        if self.T_rig_camera is None:
            return
        try:
            rigid(self.T_rig_camera)
        except ValueError as error:
            raise ValueError(f"'T_rig_camera' of {self.name}: {error}") from None

    @property
    def pose(self) -> Float64Array | None:
        """T_rig_camera (4, 4), without rounding errors of its rotation; None if it was left out."""
        return None if self.T_rig_camera is None else rigid(np.array(self.T_rig_camera))


class RigDocument(Entry, frozen=True, forbid_unknown_fields=True):
    """Several cameras with one map: `rig.json`."""

    format: Literal["cuboid-rig"]
    version: Literal[1]
    cameras: Annotated[list[RigCameraEntry], Meta(min_length=1, max_length=MAX_CAMERAS)]
    kind: Annotated[
        Literal["fixed", "moving"],
        Meta(description="fixed: the cameras stand still; moving: they move together, or each has its own poses"),
    ] = "fixed"

    def __post_init__(self) -> None:
        names = [camera.name for camera in self.cameras]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"camera '{twice}' is named twice")
        unposed = [camera.name for camera in self.cameras if camera.T_rig_camera is None]
        if unposed and self.kind == FIXED:
            raise ValueError(f"camera '{unposed[0]}' has no 'T_rig_camera'; each camera of a fixed rig needs one")
        if unposed and len(unposed) < len(names):
            raise ValueError(f"camera '{unposed[0]}' has no 'T_rig_camera', but other cameras have one")
