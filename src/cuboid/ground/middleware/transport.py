"""The interface of transports: topics to send on, topics to receive from, services."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from enum import Enum
from queue import Empty, SimpleQueue
from typing import Any, Protocol

# Number of messages stored for subscribers.
HISTORY_DEPTH = 10
# Maximum time until the answer to a call, seconds: calls are answered between two frames, and saving takes a few.
ANSWER_S = 30.0


class Qos(Enum):
    """Quality of service of a topic."""

    SENSOR = "sensor"  # best effort, newest messages only: late images are useless, and every publisher is compatible
    RELIABLE = "reliable"  # no message is lost while the subscriber is fast enough
    LATCHED = "latched"  # a later subscriber receives the last message


class Outlet(Protocol):
    """A topic to send on."""

    def wanted(self) -> bool:
        """Return whether there are subscribers."""

    def send(self, data: bytes, time_ns: int) -> None:
        """Send the bytes of a message without waiting for subscribers.

        Parameters
        ----------
        data : bytes
        time_ns : int
            Time of the data in the message.
        """


class Inlet(Protocol):
    """A topic to receive from."""

    def take(self) -> bytes | None:
        """Return the bytes of the oldest waiting message; None without one."""


@dataclass(frozen=True, slots=True)
class Request:
    """A call of a service that waits for its answer.

    Attributes
    ----------
    service : str
        Name of the service.
    data : bytes
        Bytes of the request.
    reply : callable
        Sends the bytes of the answer.
    """

    service: str
    data: bytes
    reply: Callable[[bytes], None]


class Outlets(Protocol):
    """A transport that sends topics."""

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on.

        Parameters
        ----------
        topic : str
            Full name, such as "/cuboid/detections".
        kind : str
            Full name of the type, such as "vision_msgs/msg/Detection3DArray".
        qos : Qos
        """

    def close(self) -> None:
        """Leave the network."""


class Services(Protocol):
    """A transport of services and parameters."""

    def serve(self, service: str, kind: str) -> None:
        """Offer a service.

        Parameters
        ----------
        service : str
            Full name, such as "/cuboid/reset".
        kind : str
            Full name of the type, such as "std_srvs/srv/Trigger".
        """

    def requests(self) -> Iterator[Request]:
        """Iterate over the calls that have arrived."""

    def declare(self, values: Mapping[str, Any], change: Callable[[str, Any], None]) -> None:
        """Offer parameters, if the transport has them.

        Parameters
        ----------
        values : mapping
            Current values by name.
        change : callable
            Called with a name and a new value; raises InputError for an invalid value.
        """


class Transport(Outlets, Services, Protocol):
    """A transport of topics in both directions and of services.

    Attributes
    ----------
    name : str
        Name in messages to the user.
    """

    name: str

    def topics(self) -> Mapping[str, str]:
        """Return the topics found so far, with their types."""

    def inlet(self, topic: str, kind: str, qos: Qos, kept: int, *, wakes: bool = True) -> Inlet:
        """Return a topic to receive from.

        Parameters
        ----------
        topic, kind, qos :
            As of `outlet`.
        kept : int
            Maximum number of waiting messages; the oldest are dropped.
        wakes : bool
            Whether a message on it ends `wait`.
        """

    def wait(self, seconds: float) -> None:
        """Wait for a message on an inlet with `wakes`, at most this many seconds."""


@dataclass
class PendingCalls:
    """A queue of calls: other threads add them, one thread answers them.

    Attributes
    ----------
    wait_s : float
        Maximum time until the answer, seconds; after it, the call fails.
    """

    wait_s: float = ANSWER_S
    _calls: SimpleQueue[Request] = field(default_factory=SimpleQueue)

    def call(self, service: str, data: bytes) -> bytes:
        """Wait for the answer to a call and return it; raise TimeoutError after `wait_s`."""
        answer: Future[bytes] = Future()
        self._calls.put(Request(service, data, answer.set_result))
        return answer.result(self.wait_s)

    def requests(self) -> Iterator[Request]:
        """Iterate over the waiting calls."""
        while True:
            try:
                yield self._calls.get_nowait()
            except Empty:
                return
