"""Topics and services over DDS: bytes against cyclonedds' own serializer, and what processes of ROS would send."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="DDS is not installed: pip install '.[ros2]'")
pytest.importorskip("rosbags", reason="messages are read with rosbags: pip install '.[ros2]'")
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy
from cyclonedds.qos import Qos as DdsQos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.ros_messages import VISION, RosMessages, request_of, response_of
from cuboid.ground.middleware.dds import DdsTransport, WireTypes
from cuboid.ground.middleware.transport import Qos
from made_messages import KINDS, random_message

RELIABLE = DdsQos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))


@pytest.fixture(scope="module")
def messages() -> RosMessages:
    return RosMessages("the tests", "ros2")


@pytest.fixture
def domain() -> int:
    """A domain of DDS that other runs of these tests are not in."""
    return 20 + os.getpid() % 200


@pytest.fixture
def transport(domain: int, messages: RosMessages) -> Iterator[DdsTransport]:
    made = DdsTransport(domain, messages)
    yield made
    made.close()


def within(find: Callable[[], Any], wait_s: float = 10.0) -> Any:
    """Return what is found within a time."""
    until_s = time.monotonic() + wait_s
    while (found := find()) in (None, [], False):
        assert time.monotonic() < until_s, "nothing came"
        time.sleep(0.01)
    return found


def as_cyclonedds_has_it(value: Any, kind: Any) -> Any:
    """Return a message as an object of a type of cyclonedds."""
    if isinstance(kind, type) and issubclass(kind, IdlStruct):
        fields = kind.__annotations__
        return kind(**{name: as_cyclonedds_has_it(getattr(value, name), of) for name, of in fields.items()})
    if isinstance(value, list | np.ndarray):
        inner = kind.__metadata__[0].subtype
        return [as_cyclonedds_has_it(one, inner) for one in (value.tolist() if hasattr(value, "tolist") else value)]
    return value


@pytest.mark.parametrize("kind", [*VISION, *KINDS])
def test_the_bytes_are_those_of_the_serializer_of_cyclonedds(messages: RosMessages, kind: str) -> None:
    wire = WireTypes(messages).of(kind)
    for seed in range(5):
        message = random_message(messages, kind, np.random.default_rng(seed))
        own = as_cyclonedds_has_it(message, wire).serialize(use_version_2=False)
        assert messages.encode(message) == own
        assert messages.encode(messages.decode(own, kind)) == own


def test_a_message_comes_back_as_it_was_sent_and_topics_are_found(transport: DdsTransport) -> None:
    kind = "std_msgs/msg/String"
    data = b"\x00\x01\x00\x00\x03\x00\x00\x00hi\x00"
    outlet = transport.outlet("/a/b", kind, Qos.RELIABLE)
    assert not outlet.wanted()
    inlet = transport.inlet("/a/b", kind, Qos.SENSOR, 3)
    within(outlet.wanted)
    for _ in range(5):
        outlet.send(data, 0)
    transport.wait(5.0)
    came = [inlet.take() for _ in range(4)]
    assert came[-1] is None, "the oldest are dropped where more than three wait"
    assert {one.rstrip(b"\0") for one in came[:3]} == {data.rstrip(b"\0")}
    assert within(lambda: transport.topics().get("/a/b")) == kind


def test_who_comes_later_gets_the_last_latched_message(transport: DdsTransport) -> None:
    kind = "std_msgs/msg/String"
    outlet = transport.outlet("/map", kind, Qos.LATCHED)
    for text in (b"one", b"two"):
        outlet.send(b"\x00\x01\x00\x00\x04\x00\x00\x00" + text + b"\x00", 0)
    inlet = transport.inlet("/map", kind, Qos.LATCHED, 1)
    assert b"two" in within(inlet.take)
    assert inlet.take() is None


def test_a_call_as_cyclone_dds_of_ros_makes_it_is_answered(
    domain: int, transport: DdsTransport, messages: RosMessages
) -> None:
    service, kind = "/cuboid/name", "cuboid_ros/srv/Name"
    transport.serve(service, kind)
    participant, types = DomainParticipant(domain), WireTypes(messages)
    request, response = (types.raw_type(part, called=True) for part in (request_of(kind), response_of(kind)))
    assert request.__idl_typename__ == "cuboid_ros.srv.dds_.Name_Request_"
    writer = DataWriter(participant, Topic(participant, "rq/cuboid/nameRequest", request), qos=RELIABLE)
    reader = DataReader(participant, Topic(participant, "rr/cuboid/nameReply", response), qos=RELIABLE)
    within(writer.get_matched_subscriptions)
    within(lambda: reader.get_subscription_matched_status().current_count)
    sample = request.__new__(request)
    sample.data = b"\x00\x01\x00\x00" + struct.pack("<Qq", 2**63 + 5, 42) + struct.pack("<II4s", 3, 4, b"cup\0")
    writer.write(sample)
    (asked,) = within(lambda: list(transport.requests()))
    found = messages.decode(asked.data, request_of(kind))
    assert (asked.service, found.label, found.name) == (service, 3, "cup")
    answer = messages.store.types[response_of(kind)](success=True, message="done")
    asked.reply(messages.encode(answer))
    (came,) = within(lambda: reader.take(N=1))
    assert struct.unpack_from("<Qq", came.data, 4) == (2**63 + 5, 42)
    assert messages.decode(came.data[:4] + came.data[20:], response_of(kind)).message == "done"


def test_a_domain_that_cannot_be_is_one_line(messages: RosMessages) -> None:
    with pytest.raises(InputError, match="DDS domain 9999 cannot be joined"):
        DdsTransport(9999, messages)
