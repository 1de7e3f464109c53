"""OAK cameras of Luxonis, by depthai 3 (extra ``oak``).

Options: ``id=`` which of several (its id, or its address), ``size=WIDTHxHEIGHT`` of color (640x400), ``rate=HZ`` (30).

The device undistorts color, computes depth and registers it to color.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.inputs.cameras.driver import (
    CAMERAS,
    Shot,
    StreamEndedError,
    image_size,
    library,
    refuse_unknown,
    whole_number,
)
from cuboid.inputs.readers.reader import Calibration

NAME = "oak"
OPTIONS = ("id", "size", "rate")
SIZE, RATE_HZ = "640x400", "30"
# Size of the images of the two depth cameras, pixels: all models of the series have it.
STEREO_SIZE = (640, 400)
COLOR, DEPTH = "color", "depth"
# Number of messages that wait in depthai's queue; dropped frames are counted in the queue of `LiveCamera`.
WAITING_MESSAGES = 2
# Maximum waiting time for the first images, seconds: most devices need less.
FIRST_S = 10.0
MILLIMETRES = 1000.0


class Oak:
    """A camera of depthai.

    Parameters
    ----------
    options : mapping of str to str

    Raises
    ------
    InputError
        There is no such camera, or it sends nothing.
    MissingExtraError
        depthai 3 is not installed.
    """

    has_poses = False
    paced = False
    depth_units_per_metre = MILLIMETRES

    def __init__(self, options: Mapping[str, str]) -> None:
        refuse_unknown(NAME, options, OPTIONS)
        dai = library("depthai", NAME, "oak")
        size = image_size(NAME, options.get("size", SIZE))
        rate = whole_number(NAME, "rate", options.get("rate", RATE_HZ))
        try:
            device = dai.Device(dai.DeviceInfo(options["id"])) if "id" in options else dai.Device()
            self._pipeline = dai.Pipeline(device)
            self._messages = build(dai, self._pipeline, size, rate)
            self.name = f"{device.getDeviceName()} {device.getDeviceId()}"
            self._pipeline.start()
        except RuntimeError as error:
            raise InputError(f"--camera {NAME}: {options.get('id', 'the camera')} cannot be opened: {error}") from None
        try:
            self.calibration = self._first_calibration()
        except BaseException:
            self.close()
            raise

    def _first_calibration(self) -> Calibration:
        """Return the pinhole of the first image, which includes its cropping and scaling."""
        group = self._messages.get(timedelta(seconds=FIRST_S))
        if group is None:
            raise InputError(f"{self.name}: gave no frame for {FIRST_S:g} s")
        return calibration_of(group[COLOR], self.name)

    def take(self, wait_s: float) -> Shot | None:
        """Return the next color image with its depth; None if there is none within that time."""
        if not self._pipeline.isRunning():
            raise StreamEndedError
        group = self._messages.get(timedelta(seconds=wait_s))
        return None if group is None else shot_of(group)

    def close(self) -> None:
        """Stop the device."""
        self._pipeline.stop()


def build(dai: Any, pipeline: Any, size: tuple[int, int], rate: int) -> Any:
    """Build the device's pipeline; return the queue of pairs of color and depth."""
    socket = dai.CameraBoardSocket
    color = pipeline.create(dai.node.Camera).build(socket.CAM_A)
    image = color.requestOutput(size, fps=rate, enableUndistortion=True)
    stereo, sync = pipeline.create(dai.node.StereoDepth), pipeline.create(dai.node.Sync)
    for side, eye in ((stereo.left, socket.CAM_B), (stereo.right, socket.CAM_C)):
        pipeline.create(dai.node.Camera).build(eye).requestOutput(STEREO_SIZE, fps=rate).link(side)
    depth = stereo.depth
    if pipeline.getDefaultDevice().getPlatform() == dai.Platform.RVC4:  # its stereo does not align by itself
        align = pipeline.create(dai.node.ImageAlign)
        depth.link(align.input)
        image.link(align.inputAlignTo)
        depth = align.outputAligned
    else:
        image.link(stereo.inputAlignTo)
    sync.setSyncThreshold(timedelta(seconds=0.5 / rate))
    image.link(sync.inputs[COLOR])
    depth.link(sync.inputs[DEPTH])
    return sync.out.createOutputQueue(maxSize=WAITING_MESSAGES, blocking=False)


def calibration_of(color: Any, name: str) -> Calibration:
    """Return the pinhole of a color image; raise InputError if the image has none."""
    K = np.array(color.getTransformation().getIntrinsicMatrix(), np.float64)
    if K.shape != (3, 3) or K[0, 0] <= 1.0 or K[1, 1] <= 1.0:
        raise InputError(f"{name}: the device does not know its intrinsics; calibrate it first")
    size = (int(color.getWidth()), int(color.getHeight()))
    return Calibration(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), size, "the device")


def shot_of(group: Any) -> Shot:
    """Return a pair of messages as arrays."""
    color, depth = group[COLOR], group[DEPTH]
    rgb = np.array(color.getCvFrame()[..., ::-1], np.uint8, order="C")
    return Shot(color.getTimestamp().total_seconds(), rgb, np.array(depth.getFrame(), np.uint16))


CAMERAS.register(NAME)(Oak)
