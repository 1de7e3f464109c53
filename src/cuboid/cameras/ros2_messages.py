"""The ROS 2 messages of a camera as types of cyclonedds, decoded by rosbags.

cyclonedds converts an image to a list of numbers (25 ms for 640x480), rosbags makes a view of its bytes (0.5 ms). So
messages are decoded by rosbags, and the types below only declare the wire types. A topic ``/a`` of ROS is ``rt/a``, a
type ``pkg/msg/Name`` is ``pkg::msg::dds_::Name_`` there. cyclonedds resolves annotations itself, and cannot resolve
strings: there is no ``from __future__`` here.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any, TypeVar

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosbags.typesys import Stores, get_typestore

from cuboid.core.errors import InputError

T = TypeVar("T")


@cache
def store() -> Any:
    """Return rosbags' store of message types."""
    return get_typestore(Stores.ROS2_HUMBLE)


def read_by_rosbags(kind: type[T]) -> type[T]:
    """Make rosbags decode a type of message; cyclonedds adds its sample information to the result."""
    ros_type = kind.__idl_typename__.replace(".dds_.", ".").removesuffix("_").replace(".", "/")  # type: ignore[attr-defined]

    def deserialize(data: bytes, has_header: bool = True, use_version_2: bool | None = None) -> SimpleNamespace:
        return SimpleNamespace(message=store().deserialize_cdr(bytes(data), ros_type))

    kind.deserialize = staticmethod(deserialize)  # type: ignore[attr-defined]
    return kind


@dataclass
@final
@autoid("sequential")
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    """builtin_interfaces/msg/Time."""

    sec: int32
    nanosec: uint32


@dataclass
@final
@autoid("sequential")
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    """std_msgs/msg/Header."""

    stamp: Time
    frame_id: str


@read_by_rosbags
@dataclass
@final
@autoid("sequential")
class Image(IdlStruct, typename="sensor_msgs.msg.dds_.Image_"):
    """sensor_msgs/msg/Image."""

    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@read_by_rosbags
@dataclass
@final
@autoid("sequential")
class CompressedImage(IdlStruct, typename="sensor_msgs.msg.dds_.CompressedImage_"):
    """sensor_msgs/msg/CompressedImage."""

    header: Header
    format: str
    data: sequence[uint8]


@dataclass
@final
@autoid("sequential")
class RegionOfInterest(IdlStruct, typename="sensor_msgs.msg.dds_.RegionOfInterest_"):
    """sensor_msgs/msg/RegionOfInterest."""

    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@read_by_rosbags
@dataclass
@final
@autoid("sequential")
class CameraInfo(IdlStruct, typename="sensor_msgs.msg.dds_.CameraInfo_"):
    """sensor_msgs/msg/CameraInfo."""

    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


WIRE_NAMES: dict[str, type[Image] | type[CompressedImage]] = {
    "sensor_msgs::msg::dds_::Image_": Image,
    "sensor_msgs::msg::dds_::CompressedImage_": CompressedImage,
}


PREFIX = "rt"  # of topics of ROS
TICK_S = 0.05


class TopicReader:
    """The arriving messages of a topic; the newest few are kept."""

    def __init__(self, participant: Any, topic: str, kind: Any, kept: int) -> None:
        # every publisher is compatible with best effort and volatile
        qos = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(kept))
        self._reader: Any = DataReader(participant, Topic(participant, PREFIX + topic, kind), qos=qos)

    def take(self) -> Any:
        """Return the oldest waiting message, decoded by rosbags; None if there is none."""
        for sample in self._reader.take(N=1):
            message = getattr(sample, "message", None)  # a notice that a publisher is gone has no message
            if message is not None:
                return message
        return None


class Network:
    """A participant of a DDS domain.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.

    Raises
    ------
    InputError
        There is no such domain, or no network.
    """

    def __init__(self, domain: int) -> None:
        try:
            self._participant: Any = DomainParticipant(domain)
        except DDSException as error:
            raise InputError(f"DDS domain {domain} cannot be joined: {error}") from None
        self._publications: Any = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._images: dict[str, str] = {}

    def images(self, wait_s: float, enough: Callable[[Mapping[str, str]], bool]) -> dict[str, str]:
        """Return image topics and the names of their types, once they are enough or the time is over."""
        until_s = time.monotonic() + wait_s
        while True:
            for found in self._publications.take(N=64):
                topic, kind = getattr(found, "topic_name", ""), getattr(found, "type_name", "")
                if topic.startswith(f"{PREFIX}/") and kind in WIRE_NAMES:
                    self._images[topic.removeprefix(PREFIX)] = kind
            if enough(self._images) or time.monotonic() > until_s:
                return self._images
            time.sleep(TICK_S)

    def reader(self, topic: str, kind: str, kept: int) -> TopicReader:
        """Return a reader of images."""
        return TopicReader(self._participant, topic, WIRE_NAMES[kind], kept)

    def infos(self, topic: str) -> TopicReader:
        """Return a reader of CameraInfo."""
        return TopicReader(self._participant, topic, CameraInfo, 1)

    def close(self) -> None:
        """Leave the domain; this also closes all readers in it."""
        self._publications = self._participant = None
