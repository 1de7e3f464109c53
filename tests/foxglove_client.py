"""A client of Foxglove's WebSocket protocol, as its specification has it, that reads messages with rosbags."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from rosbags.typesys import get_types_from_msg, get_typestore
from rosbags.typesys.stores import Stores
from websockets.sync.client import connect

PROTOCOL = "foxglove.sdk.v1"
MESSAGE, CALL, ANSWER = 1, 2, 3


@dataclass
class FoxgloveClient:
    """Knows of the server only what it says itself: the definitions of types too."""

    port: int
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    services: dict[str, dict[str, Any]] = field(default_factory=dict)
    messages: dict[str, list[Any]] = field(default_factory=dict)
    said: list[dict[str, Any]] = field(default_factory=list)
    answers: list[bytes] = field(default_factory=list)

    def __enter__(self) -> FoxgloveClient:
        self._open = ExitStack()
        address = f"ws://127.0.0.1:{self.port}"
        self._socket = self._open.enter_context(connect(address, subprotocols=[PROTOCOL], max_size=None))
        self._store = get_typestore(Stores.EMPTY)
        self._topics: dict[int, str] = {}
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def until(self, enough: Callable[[], bool], wait_s: float = 10.0) -> None:
        """Take what the server sends until it is enough."""
        until_s = time.monotonic() + wait_s
        while not enough():
            assert time.monotonic() < until_s, f"{self.channels.keys()} {self.messages.keys()} {self.said}"
            try:
                self._take(self._socket.recv(timeout=0.2))
            except TimeoutError:
                continue

    def subscribe(self, *topics: str) -> None:
        self.until(lambda: set(topics) <= set(self.channels))
        wanted = []
        for topic in topics:
            number = len(self._topics) + 1
            self._topics[number] = topic
            self._learn(self.channels[topic]["schemaName"], self.channels[topic]["schema"])
            wanted.append({"id": number, "channelId": self.channels[topic]["id"]})
        self._send({"op": "subscribe", "subscriptions": wanted})

    def set_parameter(self, name: str, value: Any) -> None:
        self._send({"op": "setParameters", "parameters": [{"name": name, "value": value}], "id": "set"})

    def call(self, service: str, fields: dict[str, Any]) -> Any:
        """Call a service and return its answer, by the definitions that the server gave."""
        self.until(lambda: service in self.services)
        found = self.services[service]
        request, response = found["request"], found["response"]
        for part in (request, response):
            self._learn(part["schemaName"], part["schema"])
        kind = self._name(request["schemaName"])
        data = bytes(self._store.serialize_cdr(self._store.types[kind](**fields), kind))
        self._socket.send(struct.pack("<BIII", CALL, found["id"], 9, 3) + b"cdr" + data)
        before = len(self.answers)
        self.until(lambda: len(self.answers) > before)
        return self._store.deserialize_cdr(self.answers[-1], self._name(response["schemaName"]))

    def make(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _send(self, document: dict[str, Any]) -> None:
        self._socket.send(json.dumps(document))

    def _name(self, kind: str) -> str:
        return kind.replace("/srv/", "/srv/msg/")

    def _learn(self, kind: str, text: str) -> None:
        known = get_types_from_msg(text, self._name(kind))
        self._store.register({name: types for name, types in known.items() if name not in self._store.types})

    def _take(self, data: bytes | str) -> None:
        if isinstance(data, str):
            document = json.loads(data)
            self.said.append(document)
            if document["op"] == "advertise":
                self.channels |= {one["topic"]: one for one in document["channels"]}
            elif document["op"] == "advertiseServices":
                self.services |= {one["name"]: one for one in document["services"]}
            return
        if data[0] == MESSAGE:
            number, _ = struct.unpack_from("<IQ", data, 1)
            topic = self._topics[number]
            message = self._store.deserialize_cdr(data[13:], self.channels[topic]["schemaName"])
            self.messages.setdefault(topic, []).append(message)
        elif data[0] == ANSWER:
            (length,) = struct.unpack_from("<I", data, 9)
            self.answers.append(data[13 + length :])
