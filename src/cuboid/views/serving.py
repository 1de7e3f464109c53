"""Base of the two servers: whom they answer, which requests they accept, and for how long."""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from cuboid.core.errors import OutputError

# Nobody but who is on this machine, or comes through a forwarded port, sees the results.
HOST = "127.0.0.1"
LOCAL_NAMES = ("localhost", HOST)
# Ends of names that are given within a local network only (RFC 6762, RFC 8375, and by habit).
LOCAL_ENDINGS = (".local", ".lan", ".internal", ".home.arpa", ".localdomain")

# Largest number of connections at once; a browser opens 6.
MAX_CONNECTIONS = 128
# A client that is silent for so long is cut off; so is one that takes longer to send a request, or to take an answer.
SILENT_S = 10.0
SENDING_S = 10.0
TAKING_S = 60.0
# The longest address, and the largest head of a request; browsers send about 1 kB.
LONGEST_ADDRESS = 2_000
LARGEST_HEAD = 16_000

# A page sends back a document of some kilobytes; a larger one is not from our page.
MAX_BYTES = 16 << 20

Answer = tuple[str, bytes]


def headers(*, forms: bool = False) -> dict[str, str]:
    """Return the headers of a page, which tell the browser what the page may do; `forms` may ask its own server."""
    return {
        "Cache-Control": "no-store",  # the next run's pictures have the same addresses
        # the pages hold their own scripts and style, and need nothing from elsewhere
        "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; "
        f"form-action '{'self' if forms else 'none'}'; frame-ancestors 'none'",
        "Cross-Origin-Resource-Policy": "same-origin",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
    }


class Phase(Enum):
    """The phase of a connection: the client sends a request, the server works on it, the client takes the answer."""

    SENDING = "sending"
    WORKING = "working"
    TAKING = "taking"


class Refusal(Exception):  # noqa: N818 - an answer, not a fault
    """A request cannot be answered: a status and one line for the client."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class PageHandler(BaseHTTPRequestHandler):
    """Answers GET for what is there, and POST where a page may send something back, under a name of this machine.

    Attributes
    ----------
    show : callable
        Kind and content of what lies at an address; None where nothing does.
    take : callable or None
        The same for what was sent to an address as JSON; None takes nothing.
    names : tuple of str
        Names of this machine that are answered to. With none of them number addresses and the names of a local network
        are, but no name that another site could own and have lead here.
    """

    show: Callable[[str], Answer | None]
    take: Callable[[str, bytes], Answer | None] | None = None
    names: tuple[str, ...] = LOCAL_NAMES
    timeout = SILENT_S
    server: PageServer

    def do_GET(self) -> None:
        """Answer, unless it is asked from elsewhere, or at too great a length."""
        if self._is_taken():
            self._answer(lambda: self.show(self.path))

    def do_POST(self) -> None:
        """Take what one of our own pages sends."""
        take = self.take
        if not self._is_taken():
            return
        if take is None:
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED)
            return
        # a form of another site's page can send neither this type nor our origin
        length = self.headers.get("Content-Length", "")
        if "Origin" not in self.headers or self.headers.get_content_type() != "application/json":
            self.send_error(HTTPStatus.FORBIDDEN)
        elif not (length.isascii() and length.isdecimal() and len(length) < 10 and int(length) <= MAX_BYTES):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            content = self.rfile.read(int(length))
            self._answer(lambda: take(self.path, content))

    def _is_taken(self) -> bool:
        """Tell whether a request is of bounded length and from a page of ours, or the user; refuse it else."""
        if len(self.path) > LONGEST_ADDRESS:
            self.send_error(HTTPStatus.REQUEST_URI_TOO_LONG)
        elif sum(len(name) + len(value) for name, value in self.headers.items()) > LARGEST_HEAD:
            self.send_error(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        elif not (self._is_own(f"http://{self.headers.get('Host', '')}") and self._is_own_origin()):
            self.send_error(HTTPStatus.FORBIDDEN)
        else:
            return True
        return False

    def _is_own_origin(self) -> bool:
        """Tell whether a page that asks, if one does, is our own: of this host and port."""
        own = f"http://{self.headers.get('Host', '')}"
        return all(origin == own for origin in self.headers.get_all("Origin", []))

    def _is_own(self, address: str) -> bool:
        try:
            name = urlsplit(address).hostname or ""
        except ValueError:
            return False
        return name in self.names if self.names else _is_local(name)

    def _answer(self, of: Callable[[], Answer | None]) -> None:
        self.server.enter(self.connection, Phase.WORKING)
        try:
            found, status = of(), HTTPStatus.OK
        except Refusal as refusal:
            found, status = ("text/plain; charset=utf-8", str(refusal).encode("utf-8", "replace")), refusal.status
        self.server.enter(self.connection, Phase.TAKING)
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        kind, content = found
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        for name, value in headers().items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def version_string(self) -> str:
        """Return what answers: not which Python it runs on."""
        return "cuboid"

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Say nothing: a slider asks often."""


class PageServer(ThreadingHTTPServer):
    """A server of pages with a bounded number of connections, which slow clients do not block.

    A client has a time limit for sending its request and one for taking the answer. Where there are too many
    connections, a new one takes the place of the one whose client keeps us waiting longest.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = MAX_CONNECTIONS

    def __init__(self, address: tuple[str, int], handler: type[PageHandler]) -> None:
        self._connections: dict[Any, tuple[Phase, float]] = {}  # each with its phase, and when that began
        self._lock = threading.Lock()
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own; refused where as many connections as there may be are all worked on."""
        with self._lock:
            if len(self._connections) >= MAX_CONNECTIONS:
                self._cut_longest()
            full = len(self._connections) >= MAX_CONNECTIONS
            if not full:
                self._connections[request] = Phase.SENDING, time.monotonic()
        if full:
            super().shutdown_request(request)
        else:
            super().process_request(request, client_address)

    def enter(self, request: Any, phase: Phase) -> None:
        """Note that a connection enters a phase."""
        with self._lock:
            if request in self._connections:  # it may have been cut off
                self._connections[request] = phase, time.monotonic()

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        with self._lock:
            self._connections.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Cut off clients that are too slow; called twice a second."""
        now_s = time.monotonic()
        limits_s = {Phase.SENDING: SENDING_S, Phase.TAKING: TAKING_S}
        with self._lock:
            for request, (phase, since_s) in list(self._connections.items()):
                if phase in limits_s and now_s - since_s > limits_s[phase]:
                    self._cut(request)

    def _cut_longest(self) -> None:
        """Cut off the client that keeps us waiting longest; none where all connections are worked on."""
        waiting = {
            request: since_s for request, (phase, since_s) in self._connections.items() if phase != Phase.WORKING
        }
        if waiting:
            self._cut(min(waiting, key=waiting.__getitem__))

    def _cut(self, request: Any) -> None:
        del self._connections[request]
        with suppress(OSError):  # it has gone meanwhile
            request.shutdown(socket.SHUT_RDWR)  # its thread notices, and closes it

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a connection that was cut; a fault of the program is shown."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


def listening(host: str, ports: Sequence[int], handler: type[PageHandler]) -> PageServer:
    """Return a server at the first of the ports that is free.

    Raises
    ------
    OSError
        None of them can be listened on.
    """
    for port in ports[:-1]:
        try:
            return PageServer((host, port), handler)
        except OSError:
            continue
    return PageServer((host, ports[-1]), handler)


def listening_at(port: int, handler: type[PageHandler]) -> PageServer:
    """Return a server at a port of this machine's own address; 0 takes one that is free.

    Raises
    ------
    OutputError
        The port is taken.
    """
    try:
        return PageServer((HOST, port), handler)
    except OSError as error:
        raise OutputError(f"port {port} cannot be used: {error.strerror}; leave --port out for a free one") from error


def path_and_query(address: str) -> tuple[str, str]:
    """Return the two parts of the address in a request."""
    path, _, query = address.partition("?")
    return path, query


def _is_local(name: str) -> bool:
    """Tell whether a name is an address in numbers, this machine's own, or one that only a local network gives."""
    if name and ("." not in name or name.endswith(LOCAL_ENDINGS) or name == socket.getfqdn().lower()):
        return True
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
