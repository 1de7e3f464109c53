"""A ROS 2 camera node without ROS, in a process of its own: `python publisher.py DOMAIN KIND`."""

from __future__ import annotations

import sys
import time

import numpy as np
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from hand_written_types import CameraInfo, Header, Image, RegionOfInterest, Time
from played import color_image, depth_image

WIDTH, HEIGHT = 64, 48


def image(k: int, pixels: np.ndarray, encoding: str, late_ns: int = 0) -> Image:
    """Return an image, as a node would publish it."""
    header = Header(Time(100 + k // 20, (k % 20) * 50_000_000 + late_ns), "camera_color_optical_frame")
    data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
    height, width = pixels.shape[:2]
    return Image(header, height, width, encoding, 0, len(data) // height, data.tolist())


def main(domain: int, kind: str) -> None:
    """Publish until killed."""
    participant = DomainParticipant(domain)
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(5))

    def writer(topic: str, of: type) -> DataWriter:
        return DataWriter(participant, Topic(participant, f"rt{topic}", of), qos=qos)

    color = writer("/cam/color/image_raw", Image)
    depth = writer("/cam/aligned_depth_to_color/image_raw", Image)
    infra = writer("/cam/infra1/image_raw", Image)
    info = writer("/cam/color/camera_info", CameraInfo)
    K = [64.0, 0, 32, 0, 64, 24, 0, 0, 1]
    P = [64.0, 0, 32, 0, 0, 64, 24, 0, 0, 0, 1, 0]
    roi = RegionOfInterest(0, 0, 0, 0, False)
    for k in range(2000):
        first = image(k, color_image(k % 200), "rgb8")
        lens = CameraInfo(first.header, HEIGHT, WIDTH, "plumb_bob", [0.0] * 5, K, list(np.eye(3).ravel()), P, 0, 0, roi)
        info.write(lens)
        color.write(first)
        infra.write(image(k, depth_image(0).astype(np.uint8), "mono8"))
        shape = depth_image(k % 200)[::2, ::2] if kind == "unaligned" else depth_image(k % 200)
        depth.write(image(k, shape, "16UC1", late_ns=5_000_000))
        time.sleep(0.05)


main(int(sys.argv[1]), sys.argv[2])
