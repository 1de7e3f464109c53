"""The WebSocket to Foxglove: late clients, services, parameters."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install '.[foxglove]'")
pytest.importorskip("rosbags", reason="messages are made with rosbags: pip install '.[foxglove]'")

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.foxglove import FoxgloveServer
from cuboid.ground.middleware.transport import Qos
from foxglove_client import FoxgloveClient


@pytest.fixture(scope="module")
def messages() -> RosMessages:
    return RosMessages("the tests", "foxglove")


@pytest.fixture
def server(messages: RosMessages) -> Iterator[FoxgloveServer]:
    made = FoxgloveServer(messages, port=0)
    yield made
    made.close()


def test_who_comes_later_gets_the_last_latched_message(server: FoxgloveServer, messages: RosMessages) -> None:
    latched, passing = (
        server.outlet(name, "std_msgs/msg/String", qos) for name, qos in (("/map", Qos.LATCHED), ("/now", Qos.RELIABLE))
    )
    for outlet in (latched, passing):
        for text in ("one", "two"):
            outlet.send(messages.encode(messages.make("std_msgs/String", data=text)), 5)
    assert not latched.wanted()
    with FoxgloveClient(server.port) as client:
        client.subscribe("/now", "/map")
        client.until(lambda: "/map" in client.messages)
        assert latched.wanted()
        passing.send(messages.encode(messages.make("std_msgs/String", data="three")), 5)
        client.until(lambda: "/now" in client.messages)
        assert [one.data for one in client.messages["/map"]] == ["two"]
        assert [one.data for one in client.messages["/now"]] == ["three"]


def test_a_service_is_answered_by_the_thread_that_asks_for_calls(server: FoxgloveServer, messages: RosMessages) -> None:
    kind, asked, ended = "cuboid_ros/srv/Name", [], threading.Event()
    server.serve("/cuboid/name", kind)

    def answer() -> None:
        while not ended.wait(0.01):
            for request in server.requests():
                asked.append(messages.decode(request.data, request_of(kind)))
                done = messages.store.types[response_of(kind)](success=True, message=request.service)
                request.reply(messages.encode(done))

    answering = threading.Thread(target=answer)
    answering.start()
    with FoxgloveClient(server.port) as client:
        reply = client.call("/cuboid/name", {"label": 3, "name": "cup"})
    ended.set()
    answering.join()
    assert (reply.success, reply.message, asked[0].label, asked[0].name) == (True, "/cuboid/name", 3, "cup")


def test_parameters_are_changed_or_refused_in_words(server: FoxgloveServer) -> None:
    values: dict[str, object] = {"min_probability": 0.0}

    def change(name: str, value: object) -> None:
        if name not in values:
            raise InputError(f"there is no parameter '{name}'")
        values[name] = value

    server.declare(values, change)
    with FoxgloveClient(server.port) as client:
        client.set_parameter("min_probability", 0.5)
        client.until(lambda: values["min_probability"] == 0.5)
        client.set_parameter("none", 1)
        client.until(lambda: any("there is no parameter" in one.get("message", "") for one in client.said))
        shown = [one for said in client.said if said["op"] == "parameterValues" for one in said["parameters"]]
        assert 0.5 in [one.get("value") for one in shown if one["name"] == "min_probability"]
