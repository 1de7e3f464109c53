"""Base of the two page servers: accepted clients, accepted requests, and time limits."""

from __future__ import annotations

import json
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

from cuboid.ground.core.errors import CuboidError, OutputError, one_line

# Only clients on this machine, or through a forwarded port, see the results.
HOST = "127.0.0.1"
LOCAL_NAMES = ("localhost", HOST)
# Suffixes of names that exist only within a local network (RFC 6762, RFC 8375, and common usage).
LOCAL_ENDINGS = (".local", ".lan", ".internal", ".home.arpa", ".localdomain")

# Largest number of connections at once; a browser opens 6.
MAX_CONNECTIONS = 128
# Time limits of a client, seconds: silence, sending a request, and receiving an answer. Beyond them it is disconnected.
CLIENT_SILENT_S = 10.0
SENDING_S = 10.0
TAKING_S = 60.0
# The longest address, and the largest header of a request, bytes; browsers send about 1 kB.
LONGEST_ADDRESS = 2_000
LARGEST_HEAD = 16_000

# Largest request body, bytes; a page of this program sends some kilobytes.
MAX_BODY_BYTES = 16 << 20

Answer = tuple[str, bytes]
# Returns content type and content for an address; None if there is no content.
Show = Callable[[str], Answer | None]
# Returns the same for JSON that was sent to an address.
Take = Callable[[str, bytes], Answer | None]


def headers(*, forms: bool = False) -> dict[str, str]:
    """Return the security headers of a page; with `forms` it may send forms to its own server."""
    return {
        "Cache-Control": "no-store",  # the next run's pictures have the same addresses
        # the pages contain their scripts and styles, and load nothing from other servers
        "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; "
        f"form-action '{'self' if forms else 'none'}'; frame-ancestors 'none'",
        "Cross-Origin-Resource-Policy": "same-origin",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
    }


class Phase(Enum):
    """The phase of a connection: the client sends a request, the server works on it, the client receives the answer."""

    SENDING = "sending"
    WORKING = "working"
    TAKING = "taking"


class Refusal(Exception):  # noqa: N818 - an answer, not a fault
    """A request cannot be answered: a status and one line for the client."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class PageHandler(BaseHTTPRequestHandler):
    """Answers GET requests, and POST requests of pages that may send data, under the names of this machine."""

    timeout = CLIENT_SILENT_S
    server: PageServer

    def do_GET(self) -> None:
        """Answer, unless the request is from another site or too long."""
        if self._is_taken():
            self._answer(lambda: self.server.show(self.path))

    def do_POST(self) -> None:
        """Accept the data that a page of this server sends."""
        take = self.server.take
        if not self._is_taken():
            return
        if take is None:
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED)
            return
        # a form on a page of another site can send neither this content type nor this origin
        length = self.headers.get("Content-Length", "")
        if "Origin" not in self.headers or self.headers.get_content_type() != "application/json":
            self.send_error(HTTPStatus.FORBIDDEN)
        elif not (length.isascii() and length.isdecimal() and len(length) < 10 and int(length) <= MAX_BODY_BYTES):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            content = self.rfile.read(int(length))
            self._answer(lambda: take(self.path, content))

    def _is_taken(self) -> bool:
        """Return whether a request has an accepted length, host and origin; otherwise refuse it."""
        if len(self.path) > LONGEST_ADDRESS:
            self.send_error(HTTPStatus.REQUEST_URI_TOO_LONG)
        elif sum(len(name) + len(value) for name, value in self.headers.items()) > LARGEST_HEAD:
            self.send_error(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        elif not (self._is_this_host(f"http://{self.headers.get('Host', '')}") and self._is_same_origin()):
            self.send_error(HTTPStatus.FORBIDDEN)
        else:
            return True
        return False

    def _is_same_origin(self) -> bool:
        """Return whether the request has no origin, or only the origin of this host and port."""
        this_origin = f"http://{self.headers.get('Host', '')}"
        return all(origin == this_origin for origin in self.headers.get_all("Origin", []))

    def _is_this_host(self, address: str) -> bool:
        try:
            name = urlsplit(address).hostname or ""
        except ValueError:
            return False
        return name in self.server.names if self.server.names else _is_local(name)

    def _answer(self, find: Callable[[], Answer | None]) -> None:
        self.server.enter(self.connection, Phase.WORKING)
        try:
            found, status = find(), HTTPStatus.OK
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
        """Return the name of the server, without the version of Python."""
        return "cuboid"

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Log nothing: a slider sends many requests."""


class PageServer(ThreadingHTTPServer):
    """A server of pages with a bounded number of connections, which slow clients do not block.

    A client has a time limit for sending its request, and another for receiving the answer. If there are too many
    connections, a new one replaces the connection whose client has kept the server waiting longest.

    Parameters
    ----------
    address : (str, int)
        Host and port; 0 chooses a free port.
    show : Show
    take : Take or None
        With None, POST is refused.
    names : tuple of str
        Accepted host names of this machine. If empty, numeric addresses and names of a local network are accepted, but
        no name that another site could own and direct to this machine.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = MAX_CONNECTIONS

    def __init__(
        self, address: tuple[str, int], show: Show, take: Take | None = None, names: tuple[str, ...] = LOCAL_NAMES
    ) -> None:
        self.show, self.take, self.names = show, take, names
        self._connections: dict[Any, tuple[Phase, float]] = {}  # phase of each, and the time at which it began
        self._lock = threading.Lock()
        super().__init__(address, PageHandler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a new thread; refuse the request if all allowed connections are in the phase WORKING."""
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
        """Store that a connection enters a phase."""
        with self._lock:
            if request in self._connections:  # it may be disconnected already
                self._connections[request] = phase, time.monotonic()

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        with self._lock:
            self._connections.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Disconnect clients that exceed a time limit; called twice a second."""
        now_s = time.monotonic()
        limits_s = {Phase.SENDING: SENDING_S, Phase.TAKING: TAKING_S}
        with self._lock:
            for request, (phase, since_s) in list(self._connections.items()):
                if phase in limits_s and now_s - since_s > limits_s[phase]:
                    self._cut(request)

    def _cut_longest(self) -> None:
        """Disconnect the client that has kept the server waiting longest; none if the server works on all of them."""
        waiting = {
            request: since_s for request, (phase, since_s) in self._connections.items() if phase != Phase.WORKING
        }
        if waiting:
            self._cut(min(waiting, key=waiting.__getitem__))

    def _cut(self, request: Any) -> None:
        del self._connections[request]
        with suppress(OSError):  # the client may be gone already
            request.shutdown(socket.SHUT_RDWR)  # its thread notices, and closes it

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore errors of lost connections; print errors of the program."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


def listening(host: str, ports: Sequence[int], show: Show, *, names: tuple[str, ...]) -> PageServer:
    """Return a server at the first free port of `ports`; the other parameters are those of `PageServer`.

    Raises
    ------
    OSError
        No port can be used.
    """
    for port in ports[:-1]:
        try:
            return PageServer((host, port), show, names=names)
        except OSError:
            continue
    return PageServer((host, ports[-1]), show, names=names)


def listening_at(port: int, show: Show, take: Take | None = None) -> PageServer:
    """Return a server at a port of the loopback address; the parameters are those of `PageServer`.

    Raises
    ------
    OutputError
        The port is in use.
    """
    try:
        return PageServer((HOST, port), show, take)
    except OSError as error:
        raise OutputError(f"port {port} cannot be used: {error.strerror}; omit --port to use a free one") from error


def json_answer(action: Callable[[Any], Any], content: bytes) -> Answer:
    """Return, as JSON, what a page gets for the JSON that it sent.

    Raises
    ------
    Refusal
        The user made a mistake, or the page is of another version of the program.
    """
    try:
        return "application/json", json.dumps(action(json.loads(content))).encode("ascii")
    except CuboidError as error:
        raise Refusal(HTTPStatus.UNPROCESSABLE_ENTITY, str(error)) from error
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError) as error:
        line = one_line(f"the page and the program have different versions: {error!r}")
        raise Refusal(HTTPStatus.BAD_REQUEST, line) from error


def path_and_query(address: str) -> tuple[str, str]:
    """Return path and query of the address of a request."""
    path, _, query = address.partition("?")
    return path, query


def _is_local(name: str) -> bool:
    """Return whether a name is a numeric address, the name of this machine, or a name of a local network."""
    if name and ("." not in name or name.endswith(LOCAL_ENDINGS) or name == socket.getfqdn().lower()):
        return True
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
