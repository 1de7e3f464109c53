"""ROS 2 without ROS: topics and services over DDS, by cyclonedds (extra ``ros2``).

In DDS the ROS topic ``/a`` is ``rt/a``, and the ROS type ``pkg/msg/Name`` is ``pkg::msg::dds_::Name_``. cyclonedds
would decode an image into a list of numbers (25 ms for 640x480). Therefore messages pass through it as bytes; its types
only announce the ROS type to other participants.

The ROS service ``/a`` is a pair of topics, ``rq/aRequest`` and ``rr/aReply``. Each message begins with the number of
the caller and the number of the call, as in ROS with Cyclone DDS (rmw_cyclonedds). Fast DDS sends both numbers
outside the message, where cyclonedds for Python cannot read them: nodes on Fast DDS cannot call these services.
"""

from __future__ import annotations

import os
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl import types as idl
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy
from cyclonedds.qos import Qos as DdsQos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.transport import HISTORY_DEPTH, Inlet, Outlet, Qos, Request

TOPIC, REQUEST, REPLY = "rt", "rq", "rr"
# Number of calls that wait for a service.
MAX_WAITING_CALLS = 10
# Maximum time that a writer waits for slow subscribers, seconds.
BLOCKED_S = 0.05
# Size of the header of a message, which holds the encoding; size of the two numbers that follow it in a service.
ENCODING_BYTES, CALL_BYTES = 4, 16
DISCOVERED_AT_ONCE = 64

# Default settings of Cyclone DDS; the user's environment variable replaces them. A color image of 640x480 with its
# depth has 1.5 MB: a buffer of 8 MB holds the images of 0.15 s at 30 Hz. The kernel limits the buffer to
# net.core.rmem_max.
SETTINGS, SETTINGS_VARIABLE = '<Internal><SocketReceiveBufferSize max="8MB"/></Internal>', "CYCLONEDDS_URI"

PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "string": str,
    **dict.fromkeys(("byte", "char", "octet"), idl.uint8),
    **{f"{sign}int{bits}": getattr(idl, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
    **{f"float{bits}": getattr(idl, f"float{bits}") for bits in (32, 64)},
}


class WireTypes:
    """Message types of cyclonedds, made from the message definitions of rosbags."""

    def __init__(self, messages: RosMessages) -> None:
        self._fields: Mapping[str, Any] = messages.store.fielddefs
        self._made: dict[tuple[str, bool], Any] = {}

    def of(self, kind: str, *, called: bool = False) -> Any:
        """Return the type of a message; with `called`, the two numbers of a service call are its first fields."""
        if (kind, called) not in self._made:
            package, group, *_, name = kind.split("/")  # a request of a service is "pkg/srv/msg/Name_Request"
            numbers = {"guid": idl.uint64, "seq": idl.int64} if called else {}
            fields = numbers | {field: self._field(*described) for field, described in self._fields[kind][1]}
            namespace = {"__annotations__": fields, "__module__": __name__}
            bare = types.new_class(
                name, (IdlStruct,), {"typename": f"{package}.{group}.dds_.{name}_"}, lambda body: body.update(namespace)
            )
            self._made[kind, called] = autoid("sequential")(final(dataclass(bare)))
        return self._made[kind, called]

    def raw_type(self, kind: str, *, called: bool = False) -> Any:
        """Return a type like that of `of` whose instances have one attribute, the encoded message `data`."""
        raw = self.of(kind, called=called)
        raw.serialize = _bytes_of
        raw.deserialize = staticmethod(partial(_with_bytes, raw))
        return raw

    def _field(self, node: int, described: Any) -> Any:
        """Return the type of a field; `node` of rosbags is 1: primitive, 2: message, 3: array, 4: sequence."""
        if node == 1:
            return PRIMITIVES[described[0]]
        if node == 2:
            return self.of(described)
        of, length = self._field(*described[0]), described[1]
        if node == 3:
            return idl.array[of, length]
        return idl.sequence[of, length] if length else idl.sequence[of]


def _bytes_of(self: Any, *_: Any, **__: Any) -> bytes:
    return bytes(self.data)


def _with_bytes(kind: Any, data: Any, has_header: bool = True, use_version_2: bool | None = None) -> Any:
    message = kind.__new__(kind)
    message.data = bytes(data)
    return message


class DdsTransport:
    """A participant of a DDS domain; implements `Transport`.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.
    messages : RosMessages

    Raises
    ------
    InputError
        The domain does not exist, or there is no network.
    """

    def __init__(self, domain: int, messages: RosMessages) -> None:
        os.environ.setdefault(SETTINGS_VARIABLE, SETTINGS)
        try:
            self._participant: Any = DomainParticipant(domain)
        except DDSException as error:
            raise InputError(f"DDS domain {domain} cannot be joined: {error}") from None
        self.name = f"DDS domain {domain}"
        self._types = WireTypes(messages)
        self._publications: Any = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._arrived: Any = WaitSet(self._participant)
        self._topics: dict[str, str] = {}
        self._services: dict[str, tuple[Any, Any, Any]] = {}

    def topics(self) -> Mapping[str, str]:
        """Return the ROS topics found so far, with their types."""
        while found := self._publications.take(N=DISCOVERED_AT_ONCE):
            for one in found:
                topic, kind = getattr(one, "topic_name", ""), getattr(one, "type_name", "")
                if topic.startswith(f"{TOPIC}/") and "::dds_::" in kind:
                    self._topics[topic.removeprefix(TOPIC)] = _ros_name(kind)
        return self._topics

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on; see `Outlets.outlet`."""
        raw_type = self._types.raw_type(kind)
        return _Writer(self._writer(TOPIC + topic, raw_type, qos), raw_type)

    def inlet(self, topic: str, kind: str, qos: Qos, kept: int, *, wakes: bool = True) -> Inlet:
        """Return a topic to receive from; see `Transport.inlet`."""
        reader = self._reader(TOPIC + topic, self._types.raw_type(kind), qos, kept)
        if wakes:
            self._arrived.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
        return _Reader(reader)

    def serve(self, service: str, kind: str) -> None:
        """Offer a service."""
        request, reply = (self._types.raw_type(part, called=True) for part in (request_of(kind), response_of(kind)))
        reader = self._reader(f"{REQUEST}{service}Request", request, Qos.RELIABLE, MAX_WAITING_CALLS)
        self._services[service] = reader, self._writer(f"{REPLY}{service}Reply", reply, Qos.RELIABLE), reply

    def requests(self) -> Iterator[Request]:
        """Iterate over the service calls that have arrived."""
        for service, (reader, writer, reply) in self._services.items():
            while (data := _take(reader)) is not None:
                if len(data) >= ENCODING_BYTES + CALL_BYTES:
                    head, call, rest = data[:4], data[4 : 4 + CALL_BYTES], data[4 + CALL_BYTES :]
                    yield Request(service, head + rest, partial(_answer, writer, reply, call))

    def declare(self, values: Mapping[str, Any], change: Callable[[str, Any], None]) -> None:
        """Do nothing: bare DDS lacks the parameter services of ROS; the command `set` changes parameters."""

    def wait(self, seconds: float) -> None:
        """Wait for a message, at most this many seconds."""
        self._arrived.wait(duration(seconds=seconds))

    def close(self) -> None:
        """Leave the domain; the participant closes its topics and services."""
        self._services.clear()
        self._arrived = self._publications = self._participant = None

    def _writer(self, topic: str, raw_type: Any, qos: Qos) -> Any:
        return DataWriter(
            self._participant, Topic(self._participant, topic, raw_type), qos=_dds_qos(qos, HISTORY_DEPTH)
        )

    def _reader(self, topic: str, raw_type: Any, qos: Qos, kept: int) -> Any:
        return DataReader(self._participant, Topic(self._participant, topic, raw_type), qos=_dds_qos(qos, kept))


def _dds_qos(qos: Qos, kept: int) -> Any:
    if qos is Qos.SENSOR:
        return DdsQos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(kept))
    reliable = Policy.Reliability.Reliable(duration(seconds=BLOCKED_S))
    if qos is Qos.LATCHED:
        return DdsQos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
    return DdsQos(reliable, Policy.Durability.Volatile, Policy.History.KeepLast(kept))


def _ros_name(kind: str) -> str:
    """Return the ROS name of a DDS type: "sensor_msgs/msg/Image" for "sensor_msgs::msg::dds_::Image_"."""
    return kind.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def _take(reader: Any) -> bytes | None:
    """Return the oldest waiting message of a reader; None without one."""
    while samples := reader.take(N=1):
        data: bytes | None = getattr(samples[0], "data", None)  # the notice that a publisher has left has no data
        if data is not None:
            return data
    return None


def _answer(writer: Any, kind: Any, call: bytes, data: bytes) -> None:
    writer.write(_with_bytes(kind, data[:ENCODING_BYTES] + call + data[ENCODING_BYTES:]))


class _Writer:
    """A topic to send on."""

    def __init__(self, writer: Any, kind: Any) -> None:
        self._writer, self._kind = writer, kind

    def wanted(self) -> bool:
        """Return whether there are subscribers."""
        return bool(self._writer.get_matched_subscriptions())

    def send(self, data: bytes, time_ns: int) -> None:
        """Send a message; a subscriber that is too slow loses it."""
        try:
            self._writer.write(_with_bytes(self._kind, data))
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise


class _Reader:
    """A topic to receive from."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def take(self) -> bytes | None:
        """Return the oldest waiting message; None without one."""
        return _take(self._reader)
