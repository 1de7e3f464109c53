"""A server of files as the web has them: with parts of files, lists of folders, and faults on demand."""

from __future__ import annotations

import functools
import http.server
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PART = re.compile(r"bytes=(\d+)-(\d+)")


class Handler(http.server.SimpleHTTPRequestHandler):
    """Serves a folder; its server says whether parts of files are given, and which names fail, and counts."""

    server: Server

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the overridden name
        pass

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        self.server.asked.append(self.path)
        if any(name in self.path for name in self.server.failing):
            self.send_error(500, "out of order")
            return
        match = PART.fullmatch(self.headers.get("Range", ""))
        if not path.is_file() or match is None or not self.server.parts:
            if path.is_file():
                self.server.sent += path.stat().st_size
            with suppress(BrokenPipeError, ConnectionResetError):  # the client had enough
                super().do_GET()
            return
        first, last = int(match[1]), min(int(match[2]), path.stat().st_size - 1)
        with path.open("rb") as file:
            file.seek(first)
            data = file.read(last - first + 1)
        self.server.sent += len(data)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{path.stat().st_size}")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


class Server(http.server.ThreadingHTTPServer):
    """What it did: bytes sent of files, and the paths asked for."""

    daemon_threads = True

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), functools.partial(Handler, directory=str(folder)))
        self.parts, self.sent = True, 0
        self.failing: list[str] = []
        self.asked: list[str] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


@contextmanager
def serving(folder: Path) -> Iterator[Server]:
    with Server(folder) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()
