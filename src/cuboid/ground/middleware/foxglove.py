"""A WebSocket server for Foxglove on any machine, by foxglove-sdk (extra ``foxglove``), without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import TimeoutError as AnswerTimeoutError
from typing import Any

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.transport import ANSWER_S, Outlet, PendingCalls, Qos, Request

FEATURE, EXTRA = "--foxglove", "foxglove"
HOST, PORT = "127.0.0.1", 8765
# Encoding of messages, and language of their definitions, as in ROS 2.
ENCODING, SCHEMA = "cdr", "ros2msg"
# Number of messages that wait for a slow client; if there are more, the oldest are dropped. A map has 5 MB.
BACKLOG = 64


class FoxgloveServer:
    """The server; implements `Outlets` and `Services`.

    Parameters
    ----------
    messages : RosMessages
    host : str
        Address of this machine on which the server listens; 0.0.0.0: all addresses.
    port : int
        0: any free port.

    Attributes
    ----------
    port : int
        Port on which the server listens.

    Raises
    ------
    MissingExtraError
        foxglove-sdk is not installed.
    InputError
        The port is in use, or the address is not one of this machine.
    """

    def __init__(self, messages: RosMessages, host: str = HOST, port: int = PORT) -> None:
        self._sdk = sdk = require("foxglove", FEATURE, EXTRA)
        websocket = require("foxglove.websocket", FEATURE, EXTRA)
        self._messages, self._context = messages, sdk.Context()
        self._calls = PendingCalls()
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
        except Exception as error:  # foxglove-sdk, written in Rust, names no exception types
            raise InputError(f"{FEATURE}: cannot listen on {host}:{port}: {error}") from None
        self.port: int = self._server.port

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on; see `Outlets.outlet`."""
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
        """Iterate over the service calls that have arrived."""
        return self._calls.requests()

    def close(self) -> None:
        """Stop the server."""
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
        """Return the named parameters; all parameters if `names` is empty."""
        shown = names or list(self._parameters)
        return [self._sdk.Parameter(name, value=self._parameters[name]) for name in shown if name in self._parameters]

    def _changed(self, parameters: Sequence[Any]) -> list[Any]:
        """Change parameters; return their new values. A parameter with an invalid value is not changed."""
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
    """A topic to send on."""

    def __init__(self, channel: Any, *, latched: bool) -> None:
        self._channel, self.latched = channel, latched
        self._last: tuple[bytes, int] | None = None

    def wanted(self) -> bool:
        """Return whether there are subscribers."""
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
