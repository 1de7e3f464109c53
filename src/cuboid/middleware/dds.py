"""ROS 2 without ROS: topics and services over DDS, by cyclonedds (extra ``ros2``).

A topic ``/a`` of ROS is ``rt/a`` in DDS, a type ``pkg/msg/Name`` is ``pkg::msg::dds_::Name_``. cyclonedds would make
a list of numbers of an image (25 ms for 640x480): bytes go through it as they are, and the types made here only say on
the wire what is meant.

A service ``/a`` is the topics ``rq/aRequest`` and ``rr/aReply``, whose messages begin with the numbers of the caller
and of its call, as ROS's Cyclone DDS (rmw_cyclonedds) has it. Fast DDS puts both elsewhere, where cyclonedds for
Python does not reach: nodes on Fast DDS cannot call these services.
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

from cuboid.core.errors import InputError
from cuboid.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.middleware.transport import Inlet, Outlet, Qos, Request

TOPIC, REQUEST, REPLY = "rt", "rq", "rr"
# Kept for those that listen, and waiting calls of a service.
KEPT, CALLS_KEPT = 10, 10
# A writer whose listeners do not keep up waits no longer than this for them, seconds.
BLOCKED_S = 0.05
# DDS writes this before a message: its encoding. The number of a caller and of its call follow in services.
ENCODING_BYTES, CALL_BYTES = 4, 16
DISCOVERED_AT_ONCE = 64

# Settings of Cyclone DDS unless the user has some. An image of 640x480 with its depth has 1.5 MB: a buffer of 8 MB
# holds those that arrive in 0.15 s at 30 Hz. The kernel limits it to net.core.rmem_max.
SETTINGS, SETTINGS_VARIABLE = '<Internal><SocketReceiveBufferSize max="8MB"/></Internal>', "CYCLONEDDS_URI"

PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "string": str,
    **dict.fromkeys(("byte", "char", "octet"), idl.uint8),
    **{f"{sign}int{bits}": getattr(idl, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
    **{f"float{bits}": getattr(idl, f"float{bits}") for bits in (32, 64)},
}


class WireTypes:
    """Types of messages as cyclonedds has them, made of what rosbags knows of them."""

    def __init__(self, messages: RosMessages) -> None:
        self._fields: Mapping[str, Any] = messages.store.fielddefs
        self._made: dict[tuple[str, bool], Any] = {}

    def of(self, kind: str, *, called: bool = False) -> Any:
        """Return the type of a message, with the numbers of a call before it where it is one of a service."""
        if (kind, called) not in self._made:
            package, group, *_, name = kind.split("/")  # of a service "pkg/srv/msg/Name_Request"
            numbers = {"guid": idl.uint64, "seq": idl.int64} if called else {}
            fields = numbers | {field: self._field(*described) for field, described in self._fields[kind][1]}
            namespace = {"__annotations__": fields, "__module__": __name__}
            bare = types.new_class(
                name, (IdlStruct,), {"typename": f"{package}.{group}.dds_.{name}_"}, lambda body: body.update(namespace)
            )
            self._made[kind, called] = autoid("sequential")(final(dataclass(bare)))
        return self._made[kind, called]

    def carried(self, kind: str, *, called: bool = False) -> Any:
        """Return a type like `of` whose objects hold the bytes of a message in `data` and nothing else."""
        carried = self.of(kind, called=called)
        carried.serialize = _bytes_of
        carried.deserialize = staticmethod(partial(_holding, carried))
        return carried

    def _field(self, node: int, described: Any) -> Any:
        """Return a field: rosbags' kinds of nodes are 1 a primitive, 2 a message, 3 an array, 4 a sequence."""
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


def _holding(kind: Any, data: Any, has_header: bool = True, use_version_2: bool | None = None) -> Any:
    held = kind.__new__(kind)
    held.data = bytes(data)
    return held


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
        There is no such domain, or no network.
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
        """Return the topics of ROS that were found so far, and their types."""
        while found := self._publications.take(N=DISCOVERED_AT_ONCE):
            for one in found:
                topic, kind = getattr(one, "topic_name", ""), getattr(one, "type_name", "")
                if topic.startswith(f"{TOPIC}/") and "::dds_::" in kind:
                    self._topics[topic.removeprefix(TOPIC)] = _ros_name(kind)
        return self._topics

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on."""
        carried = self._types.carried(kind)
        return _Writer(self._writer(TOPIC + topic, carried, qos), carried)

    def inlet(self, topic: str, kind: str, qos: Qos, kept: int, *, wakes: bool = True) -> Inlet:
        """Return a topic to take from."""
        reader = self._reader(TOPIC + topic, self._types.carried(kind), qos, kept)
        if wakes:
            self._arrived.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
        return _Reader(reader)

    def serve(self, service: str, kind: str) -> None:
        """Offer a service."""
        request, reply = (self._types.carried(part, called=True) for part in (request_of(kind), response_of(kind)))
        reader = self._reader(f"{REQUEST}{service}Request", request, Qos.RELIABLE, CALLS_KEPT)
        self._services[service] = reader, self._writer(f"{REPLY}{service}Reply", reply, Qos.RELIABLE), reply

    def requests(self) -> Iterator[Request]:
        """Give the calls of services that have come."""
        for service, (reader, writer, reply) in self._services.items():
            while (data := _take(reader)) is not None:
                if len(data) >= ENCODING_BYTES + CALL_BYTES:
                    head, call, rest = data[:4], data[4 : 4 + CALL_BYTES], data[4 + CALL_BYTES :]
                    yield Request(service, head + rest, partial(_answer, writer, reply, call))

    def declare(self, values: Mapping[str, Any], change: Callable[[str, Any], None]) -> None:
        """Nothing: ROS asks for parameters by services of its own; here the command `set` changes them."""

    def wait(self, seconds: float) -> None:
        """Return as soon as a message waits, or the time is over."""
        self._arrived.wait(duration(seconds=seconds))

    def close(self) -> None:
        """Leave the domain: what was made in it ends with the participant."""
        self._services.clear()
        self._arrived = self._publications = self._participant = None

    def _writer(self, topic: str, carried: Any, qos: Qos) -> Any:
        return DataWriter(self._participant, Topic(self._participant, topic, carried), qos=_dds_qos(qos, KEPT))

    def _reader(self, topic: str, carried: Any, qos: Qos, kept: int) -> Any:
        return DataReader(self._participant, Topic(self._participant, topic, carried), qos=_dds_qos(qos, kept))


def _dds_qos(qos: Qos, kept: int) -> Any:
    if qos is Qos.SENSOR:
        return DdsQos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(kept))
    reliable = Policy.Reliability.Reliable(duration(seconds=BLOCKED_S))
    if qos is Qos.LATCHED:
        return DdsQos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
    return DdsQos(reliable, Policy.Durability.Volatile, Policy.History.KeepLast(kept))


def _ros_name(kind: str) -> str:
    """Return "sensor_msgs/msg/Image" of "sensor_msgs::msg::dds_::Image_"."""
    return kind.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def _take(reader: Any) -> bytes | None:
    """Return the oldest message of a reader."""
    while samples := reader.take(N=1):
        data: bytes | None = getattr(samples[0], "data", None)  # the word that a publisher has gone has none
        if data is not None:
            return data
    return None


def _answer(writer: Any, kind: Any, call: bytes, data: bytes) -> None:
    writer.write(_holding(kind, data[:ENCODING_BYTES] + call + data[ENCODING_BYTES:]))


class _Writer:
    """A topic that is sent on."""

    def __init__(self, writer: Any, kind: Any) -> None:
        self._writer, self._kind = writer, kind

    def wanted(self) -> bool:
        """Tell whether somebody listens."""
        return bool(self._writer.get_matched_subscriptions())

    def send(self, data: bytes, time_ns: int) -> None:
        """Send a message; one that no listener takes in time is lost to it."""
        try:
            self._writer.write(_holding(self._kind, data))
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise


class _Reader:
    """A topic that is taken from."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def take(self) -> bytes | None:
        """Return the oldest message that is there; None where there is none."""
        return _take(self._reader)
