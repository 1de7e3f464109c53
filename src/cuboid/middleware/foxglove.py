"""A WebSocket that Foxglove on any machine connects to, by foxglove-sdk (extra ``foxglove``): no ROS is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import TimeoutError as AnswerTimeoutError
from typing import Any

from cuboid.core.errors import InputError
from cuboid.core.extras import require
from cuboid.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.middleware.transport import Outlet, PendingCalls, Qos, Request

FEATURE, EXTRA = "--foxglove", "foxglove"
HOST, PORT = "127.0.0.1", 8765
# Bytes of messages, and names of their definitions, as ROS 2 has them.
ENCODING, SCHEMA = "cdr", "ros2msg"
# Messages that wait for a client which does not keep up; older ones are dropped. A map has 5 MB.
BACKLOG = 64
# A call is answered between two frames: one that takes longer has failed, seconds. Saving takes a few.
ANSWER_S = 30.0


class FoxgloveServer:
    """The server; implements `Outlets` and `Services`.

    Parameters
    ----------
    messages : RosMessages
    host : str
        Address of this machine that it listens on, 0.0.0.0 for all.
    port : int
        0 for a free one.

    Attributes
    ----------
    port : int
        Where it listens.

    Raises
    ------
    MissingExtraError
        foxglove-sdk is not installed.
    InputError
        The port is taken, or the address is none of this machine.
    """

    def __init__(self, messages: RosMessages, host: str = HOST, port: int = PORT) -> None:
        self._sdk = sdk = require("foxglove", FEATURE, EXTRA)
        websocket = require("foxglove.websocket", FEATURE, EXTRA)
        self._messages, self._context = messages, sdk.Context()
        self._calls = PendingCalls(ANSWER_S)
        self._latched: dict[int, _Channel] = {}
        self._parameters: dict[str, Any] = {}
        self._change: Callable[[str, Any], None] = lambda name, value: None
        callbacks = {
            "on_subscribe": lambda _, client, channel: self._subscribed(channel.id),
            "on_get_parameters": lambda _, client, names, request=None: self._given(names),
            "on_set_parameters": lambda _, client, parameters, request=None: self._changed(parameters),
        }
        try:
            self._server: Any = sdk.start_server(
                name="cuboid",
                host=host,
                port=port,
                capabilities=[sdk.Capability.Services, sdk.Capability.Parameters],
                supported_encodings=[ENCODING],
                context=self._context,
                server_listener=type("Listener", (websocket.ServerListener,), callbacks)(),
                message_backlog_size=BACKLOG,
            )
        except Exception as error:  # of a library in Rust, which names no kinds
            raise InputError(f"{FEATURE}: {host}:{port} cannot be served: {error}") from None
        self.port: int = self._server.port

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on."""
        channel = self._sdk.Channel(topic, message_encoding=ENCODING, schema=self._schema(kind), context=self._context)
        made = _Channel(channel, latched=qos is Qos.LATCHED)
        if made.latched:
            self._latched[channel.id()] = made
        return made

    def serve(self, service: str, kind: str) -> None:
        """Offer a service."""
        request, response = (
            self._sdk.MessageSchema(encoding=ENCODING, schema=self._schema(part))
            for part in (request_of(kind), response_of(kind))
        )
        schema = self._sdk.ServiceSchema(kind, request=request, response=response)
        self._server.add_services([self._sdk.Service(service, schema=schema, handler=self._answer)])

    def requests(self) -> Iterator[Request]:
        """Give the calls of services that have come."""
        return self._calls.requests()

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def _schema(self, kind: str) -> Any:
        return self._sdk.Schema(
            name=kind.replace("/srv/msg/", "/srv/"), encoding=SCHEMA, data=self._messages.definition(kind).encode()
        )

    def _answer(self, request: Any) -> bytes:
        try:
            return self._calls.call(request.service_name, request.payload)
        except AnswerTimeoutError:
            raise RuntimeError(f"no answer within {ANSWER_S:g} s") from None

    def declare(self, values: Mapping[str, Any], change: Callable[[str, Any], None]) -> None:
        """Offer parameters."""
        self._parameters, self._change = dict(values), change
        self._server.publish_parameter_values(self._given([]))

    def _given(self, names: Sequence[str]) -> list[Any]:
        """Return parameters, all where none is named."""
        shown = names or list(self._parameters)
        return [self._sdk.Parameter(name, value=self._parameters[name]) for name in shown if name in self._parameters]

    def _changed(self, parameters: Sequence[Any]) -> list[Any]:
        """Change parameters, and return them as they are then: one that cannot be so stays as it was."""
        for one in parameters:
            try:
                self._change(one.name, one.get_value())
                self._parameters[one.name] = one.get_value()
            except InputError as error:
                self._server.publish_status(str(error), self._sdk.StatusLevel.Warning)
        return self._given([one.name for one in parameters])

    def _subscribed(self, channel: int) -> None:
        """Send the last message of a latched topic to a later subscriber."""
        if channel in self._latched:
            self._latched[channel].repeat()


class _Channel:
    """A topic that is sent on."""

    def __init__(self, channel: Any, *, latched: bool) -> None:
        self._channel, self.latched = channel, latched
        self._last: tuple[bytes, int] | None = None

    def wanted(self) -> bool:
        """Tell whether somebody listens."""
        return bool(self._channel.has_sinks())

    def send(self, data: bytes, time_ns: int) -> None:
        """Send a message."""
        if self.latched:
            self._last = data, time_ns
        self._channel.log(data, log_time=time_ns)

    def repeat(self) -> None:
        """Send the last message again."""
        if self._last is not None:
            self._channel.log(self._last[0], log_time=self._last[1])
