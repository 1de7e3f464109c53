"""URLs that are none, and servers that answer with anything: a line, from whatever asks them."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from cuboid.fleet.batch.sources import BatchSource, expand
from cuboid.fleet.batch.task import head_of
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.ground.core.errors import CuboidError, InputError

ANSWERS = {
    "nothing": b"",
    "noise": bytes(range(256)) * 9,
    "a file of this machine": b"HTTP/1.1 302 Found\r\nLocation: file:///etc/passwd\r\nContent-Length: 0\r\n\r\n",
    "itself": b"HTTP/1.1 302 Found\r\nLocation: /round.zip\r\nContent-Length: 0\r\n\r\n",
    "less than it says": b"HTTP/1.1 200 OK\r\nContent-Length: 99999\r\n\r\nPK",
    "a long header": b"HTTP/1.1 200 OK\r\nA: " + b"b" * 100_000 + b"\r\n\r\n",
    "codes for a terminal": b"HTTP/1.1 500 \x1b[2Jevil\r\nContent-Length: 0\r\n\r\n",
}
NO_URLS = ["http://", "http://[::1", "http://127.0.0.1:99999/a.zip", "rtsp://x", "s3://"]


@contextmanager
def answering(content: bytes) -> Iterator[str]:
    """A server that answers whatever it is asked with this, and hangs up."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                client, _ = server.accept()
            except OSError:
                return
            with client:
                try:
                    client.settimeout(5)
                    client.recv(4096)
                    client.sendall(content)
                except OSError:
                    continue

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.getsockname()[1]}"
    finally:
        server.shutdown(socket.SHUT_RDWR)
        server.close()


def is_refused(work: Callable[[], object]) -> None:
    with pytest.raises(CuboidError) as caught:
        work()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)
def test_a_server_that_fails_is_told_in_one_line(answer: bytes) -> None:
    with answering(answer) as url:
        is_refused(lambda: head_of(BatchSource("a", f"{url}/a.zip"), {}, "1"))
        is_refused(lambda: expand([f"{url}/*.zip"]))
        is_refused(lambda: Tables(f"{url}/store"))


@pytest.mark.parametrize("url", NO_URLS)
def test_no_store_lies_at_what_is_no_url(url: str) -> None:
    is_refused(lambda: Tables(url))
    is_refused(lambda: StoreFolder(url).create("a", b""))


@pytest.mark.parametrize("url", [*NO_URLS, "ftp://127.0.0.1/a.zip"])
def test_what_is_no_url_of_a_recording_is_told_in_one_line(url: str, refused: Callable[..., str]) -> None:
    refused("info", url)


def test_a_url_that_names_no_place_makes_no_folder() -> None:
    with pytest.raises(InputError, match="expected a folder or URL"):
        StoreFolder("http://")
