"""`cuboid serve` and `cuboid mcp --http` as processes of their own, and applications in threads of the tests."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from urllib.parse import urlsplit

import uvicorn
from starlette.types import ASGIApp


@contextmanager
def served(path: str, *words: str, command: str = "serve") -> Iterator[str]:
    """Serve a store or a place, and give the address that the command prints; Ctrl-C ends it."""
    environment = {name: value for name, value in os.environ.items() if name != "CUBOID_TOKEN"}
    call = [sys.executable, "-m", "cuboid", command, path, "--port", "0", *words]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split(" at ")[1].split(" (")[0].rstrip("/")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()


@contextmanager
def serving(app: ASGIApp) -> Iterator[str]:
    """Serve an application from a thread, and give its address."""
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=1))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(20)
        listening.close()


def refuses_large_bodies(address: str) -> None:
    """Check that a server refuses bodies of 6 GB and of unknown length, and ends the connection, before reading."""
    url = urlsplit(address)
    for method in ("GET", "POST"):
        for head in (f"Content-Length: {6 << 30}", "Transfer-Encoding: chunked"):
            with closing(socket.create_connection((url.hostname, url.port), 30)) as client:
                request = f"{method} {url.path or '/'} HTTP/1.1\r\nHost: {url.netloc}\r\n{head}\r\n\r\n"
                client.sendall(request.encode())
                answer = client.makefile("rb").read()  # ends although no byte of the body was sent
            assert answer.startswith(b"HTTP/1.1 413 "), answer
            assert b"at most 16777216 bytes" in answer
