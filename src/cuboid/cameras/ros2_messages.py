"""The messages of ROS 2 that a camera sends, as cyclonedds knows types; read by rosbags.

cyclonedds makes a list of numbers of an image (25 ms for 640x480), rosbags a view of its bytes (0.5 ms): what arrives
is read by the latter, and the types below only say on the wire what is meant. A topic ``/a`` of ROS is ``rt/a``,
a type ``pkg/msg/Name`` is ``pkg::msg::dds_::Name_`` there. cyclonedds resolves
annotations by itself, and only those that are no texts: there is no ``from __future__`` here.
"""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any, TypeVar

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from rosbags.typesys import Stores, get_typestore

T = TypeVar("T")


@cache
def store() -> Any:
    """Return rosbags' knowledge of message types."""
    return get_typestore(Stores.ROS2_HUMBLE)


def read_by_rosbags(kind: type[T]) -> type[T]:
    """Let what arrives of a type of message be read by rosbags; cyclonedds notes in the result how it came."""
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
