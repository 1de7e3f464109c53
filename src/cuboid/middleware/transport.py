"""The interface of what carries messages: topics out, topics in, services."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from enum import Enum
from queue import Empty, SimpleQueue
from typing import Any, Protocol


class Qos(Enum):
    """How a topic is carried."""

    SENSOR = "sensor"  # best effort, the newest few: what arrives late is worth nothing, and every publisher fits
    RELIABLE = "reliable"  # nothing is lost between two that keep up
    LATCHED = "latched"  # who comes later gets the last one too


class Outlet(Protocol):
    """A topic that messages are sent on."""

    def wanted(self) -> bool:
        """Tell whether somebody listens."""

    def send(self, data: bytes, time_ns: int) -> None:
        """Send the bytes of a message; it does not wait for who listens.

        Parameters
        ----------
        data : bytes
        time_ns : int
            What the message tells of.
        """


class Inlet(Protocol):
    """A topic that messages are taken from."""

    def take(self) -> bytes | None:
        """Return the bytes of the oldest message that is there; None where there is none."""


@dataclass(frozen=True, slots=True)
class Request:
    """A call of a service that waits for its answer.

    Attributes
    ----------
    service : str
        Its name.
    data : bytes
        Of the request's message.
    reply : callable
        Sends the bytes of the answer's message.
    """

    service: str
    data: bytes
    reply: Callable[[bytes], None]


class Outlets(Protocol):
    """Carries topics out."""

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on.

        Parameters
        ----------
        topic : str
            Its full name, "/cuboid/detections" say.
        kind : str
            Full name of its type, "vision_msgs/msg/Detection3DArray" say.
        qos : Qos
        """

    def close(self) -> None:
        """Leave."""


class Services(Protocol):
    """Carries calls of services in and their answers out, and parameters."""

    def serve(self, service: str, kind: str) -> None:
        """Offer a service, by its full name and that of its type ("std_srvs/srv/Trigger")."""

    def requests(self) -> Iterator[Request]:
        """Give the calls that have come."""

    def declare(self, values: Mapping[str, Any], change: Callable[[str, Any], None]) -> None:
        """Offer parameters, where it can.

        Parameters
        ----------
        values : mapping
            By name, as they are now.
        change : callable
            Told of a name and a new value; raises InputError where it cannot be one.
        """


class Transport(Outlets, Services, Protocol):
    """Carries topics in and out, and services.

    Attributes
    ----------
    name : str
        What messages to the user call it.
    """

    name: str

    def topics(self) -> Mapping[str, str]:
        """Return the topics that somebody publishes so far, and their types."""

    def inlet(self, topic: str, kind: str, qos: Qos, kept: int, *, wakes: bool = True) -> Inlet:
        """Return a topic to take from.

        Parameters
        ----------
        topic, kind, qos :
            As of `outlet`.
        kept : int
            So many messages wait at most; the oldest are dropped.
        wakes : bool
            Whether a message ends `wait`.
        """

    def wait(self, seconds: float) -> None:
        """Return as soon as a message waits on an inlet that wakes, or the time is over."""


@dataclass
class PendingCalls:
    """Calls that other threads make, for the one thread that answers them.

    Attributes
    ----------
    wait_s : float
        A call that is not answered in this time fails.
    """

    wait_s: float
    _calls: SimpleQueue[Request] = field(default_factory=SimpleQueue)

    def call(self, service: str, data: bytes) -> bytes:
        """Return the answer, in the calling thread; raises TimeoutError where there is none in time."""
        answer: Future[bytes] = Future()
        self._calls.put(Request(service, data, answer.set_result))
        return answer.result(self.wait_s)

    def requests(self) -> Iterator[Request]:
        """Give the calls that wait."""
        while True:
            try:
                yield self._calls.get_nowait()
            except Empty:
                return
