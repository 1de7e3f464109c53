"""Pages served to the browser of this machine: who is answered, and what may be sent back."""

from __future__ import annotations

import sys
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from cuboid.errors import OutputError

# Nobody but who is on this machine, or comes through a forwarded port, sees the pages.
HOST = "127.0.0.1"
LOCAL_NAMES = ("localhost", HOST)

# What a page sends back is a document of some kilobytes; more than this is none of ours.
MOST_BYTES = 16 << 20

Answer = tuple[str, bytes]


class Refusal(Exception):  # noqa: N818 - an answer, not a fault
    """What was asked cannot be done: a status and one line for who asked."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class PageHandler(BaseHTTPRequestHandler):
    """Answers GET for what is there, and POST where a page may send something back.

    Attributes
    ----------
    show : callable
        Kind and content of what lies at an address; None where nothing does.
    take : callable or None
        The same for what was sent to an address as JSON; None takes nothing.
    names : tuple of str
        Names of this machine that are answered to; none stands for any.
    """

    show: Callable[[str], Answer | None]
    take: Callable[[str, bytes], Answer | None] | None = None
    names: tuple[str, ...] = LOCAL_NAMES

    def do_GET(self) -> None:
        """Answer, unless it was asked for under another name."""
        if self._is_ours():
            self._answer(lambda: self.show(self.path))

    def do_POST(self) -> None:
        """Take what one of our own pages sends."""
        take = self.take
        if not self._is_ours():
            return
        if take is None:
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED)
            return
        # a form of another site's page can send neither this type nor our origin
        length = self.headers.get("Content-Length", "")
        if "Origin" not in self.headers or self.headers.get_content_type() != "application/json":
            self.send_error(HTTPStatus.FORBIDDEN)
        elif not length.isdecimal() or int(length) > MOST_BYTES:
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            content = self.rfile.read(int(length))
            self._answer(lambda: take(self.path, content))

    def _is_ours(self) -> bool:
        """Tell whether it was asked under a name of this machine, by a page of ours or by the user; refuse it else."""
        # another site's page may have its own name lead to this address: it gets nothing
        host = self.headers.get("Host", "")
        own_origin = self.headers.get("Origin", f"http://{host}") == f"http://{host}"
        ours = not self.names or (host.rsplit(":", 1)[0] in self.names and own_origin)
        if not ours:
            self.send_error(HTTPStatus.FORBIDDEN)
        return ours

    def _answer(self, of: Callable[[], Answer | None]) -> None:
        try:
            found, status = of(), HTTPStatus.OK
        except Refusal as refusal:
            found, status = ("text/plain; charset=utf-8", str(refusal).encode("utf-8")), refusal.status
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        kind, content = found
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")  # the next run's pictures have the same addresses
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Say nothing: a slider asks often."""


class PageServer(ThreadingHTTPServer):
    """A server that takes it calmly when somebody closes the page."""

    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a connection that was cut; a fault of the program is shown."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


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
