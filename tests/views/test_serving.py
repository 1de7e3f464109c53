"""The servers before clients that mean ill, or are only slow."""

from __future__ import annotations

import shutil
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from asked import asked
from browser import Watched, answering
from cuboid.inputs.readers import open_recording
from cuboid.results.files import Results
from cuboid.results.views import serving
from cuboid.results.views.live import LiveServer, LiveView
from cuboid.results.views.replay import Replay
from cuboid.results.views.report import summarise, write_report
from cuboid.results.views.report.server import Viewer, make_server
from cuboid.results.views.serving import HOST, PageServer
from fakes import INTRINSICS
from made_results import write_results

TEXT = "</script><img src=x onerror=document.title='caught'>"
EVIL = TEXT.replace("/", "\u2215")  # the name of a folder has no slash


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_results(tmp_path_factory.mktemp("serving"))


@pytest.fixture
def port(results: Path) -> Iterator[int]:
    viewer = Viewer(results, Replay(results), open_recording(results.parent / "recording"))
    with make_server(viewer) as found, answering(found):
        yield found.server_port


def status(port: int, path: str = "/frame/0.jpg", method: str = "GET", **headers: str) -> int:
    return asked(port, path, method, **headers)[0]


def said(port: int, content: bytes, wait_s: float = 5.0) -> bytes:
    """Return what is answered to raw bytes."""
    with socket.create_connection((HOST, port), timeout=wait_s) as client:
        try:
            client.sendall(content)
            with suppress(OSError):  # closed by the other side, who has heard enough
                client.shutdown(socket.SHUT_WR)
            return b"".join(iter(lambda: client.recv(65536), b""))
        except ConnectionError:
            return b""


def test_who_asks_from_elsewhere_gets_nothing(port: int) -> None:
    assert status(port) == 200
    assert status(port, Host=f"localhost:{port}", Origin=f"http://localhost:{port}") == 200
    for host in ("evil.example", "localhost.evil.example", "", "[::", "127.0.0.1.evil.example"):
        assert status(port, Host=host) == 403, host
    for origin in ("http://evil.example", "null", "http://[", f"http://localhost.evil.example:{port}"):
        assert status(port, Origin=origin) == 403, origin


@pytest.mark.parametrize("method", ["PUT", "DELETE", "HEAD", "OPTIONS", "CONNECT", "TRACE", "X"])
def test_there_is_no_other_method(port: int, method: str) -> None:
    assert status(port, method=method) == 501


def test_long_and_strange_requests_are_refused(port: int, capfd: pytest.CaptureFixture[str]) -> None:
    assert status(port, "/" + "x" * 3000) == 414
    assert status(port, X="y" * 20_000) == 431
    for path in ("//[", "/frame/%00.jpg", "/../../etc/passwd", "/frame/0.jpg/..", "/frame/" + "9" * 50 + ".jpg"):
        assert status(port, path) == 404, path
    assert status(port, "/frame/0.jpg?" + "what=a&" * 200) == 404
    for content in (
        b"",
        b"\n",
        b"\0" * 100,
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01",
        b"GET /" + b"x" * 100_000,
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 5000 + b"\r\n",
        b"GET / HTTP/1.1\r\nA: " + b"b" * 70_000 + b"\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ):
        assert b" 200 " not in said(port, content)[:20], content[:40]
    assert status(port) == 200
    assert "Traceback" not in capfd.readouterr().err


def test_clients_that_leave_are_no_fault(port: int, capfd: pytest.CaptureFixture[str]) -> None:
    for _ in range(20):
        client = socket.create_connection((HOST, port))
        client.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # a reset, not a polite end
        client.close()
    assert status(port) == 200
    assert capfd.readouterr().err == ""


def test_slow_clients_are_cut_and_hold_up_nobody(
    port: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(serving, "SENDING_S", 0.5)
    clients = [socket.create_connection((HOST, port), timeout=20) for _ in range(50)]
    for client in clients:
        client.sendall(b"GET / HTTP/1.1\r\nX: ")
    assert status(port) == 200
    begun_s = time.monotonic()
    while time.monotonic() - begun_s < 20:  # a byte now and then does not keep it open
        try:
            clients[0].sendall(b"y")
        except OSError:
            break
        time.sleep(0.1)
    assert time.monotonic() - begun_s < 10
    for client in clients:
        client.close()
    assert capfd.readouterr().err == ""


def test_fifty_clients_at_once_are_answered(port: int) -> None:
    found: list[int] = []
    threads = [threading.Thread(target=lambda: found.append(status(port))) for _ in range(50)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [200] * 50


def dripping(port: int, count: int) -> list[socket.socket]:
    """Return connections that never finish their requests."""
    clients = [socket.create_connection((HOST, port), timeout=20) for _ in range(count)]
    for client in clients:
        with suppress(OSError):  # cut off already
            client.sendall(b"GET / HTTP/1.1\r\nX: ")
    return clients


def test_dripping_connections_do_not_shut_out_a_quick_request(
    port: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(PageServer, "service_actions", lambda self: None)  # no time limit helps
    threads = threading.active_count()
    clients = dripping(port, 140)
    assert [status(port) for _ in range(5)] == [200] * 5
    assert threading.active_count() - threads <= serving.MAX_CONNECTIONS + 20  # of those cut off some still end
    assert clients[0].recv(1) == b""  # the oldest ones had to go
    clients[-1].settimeout(0.05)
    with pytest.raises(TimeoutError):  # the newest has not been cut off
        clients[-1].recv(1)
    for client in clients:
        client.close()
    assert "Traceback" not in capfd.readouterr().err


def test_a_connection_that_is_worked_on_is_not_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "MAX_CONNECTIONS", 3)
    go, begun = threading.Event(), threading.Semaphore(0)

    def show(address: str) -> serving.Answer:
        begun.release()
        assert go.wait(20)
        return "text/plain", b"done"

    found: list[int] = []
    with serving.listening_at(0, show) as server, answering(server):
        port = server.server_port
        asking = [threading.Thread(target=lambda: found.append(status(port))) for _ in range(3)]
        for thread in asking:
            thread.start()
            assert begun.acquire(timeout=20)
        with socket.create_connection((HOST, port), timeout=20) as client:
            assert client.recv(1) == b""  # there is no room
        go.set()
        for thread in asking:
            thread.join()
    assert found == [200] * 3


def test_a_live_view_for_others_answers_to_no_name_of_another_site() -> None:
    with LiveServer(LiveView(), "mine", INTRINSICS, "0.0.0.0") as server:
        assert status(server.port, "/", Host=f"192.168.0.7:{server.port}") == 200
        assert status(server.port, "/", Host="evil.example") == 403
        assert status(server.port, "/", Origin="http://evil.example") == 403


def test_a_name_is_text_wherever_it_is_shown(launched: Browser, results: Path, tmp_path: Path) -> None:
    recording = tmp_path / EVIL
    shutil.copytree(results.parent / "recording", recording)
    mine = tmp_path / "results"
    shutil.copytree(results, mine)
    run = (mine / "run.json").read_text(encoding="utf-8")
    old = str(results.parent / "recording")
    (mine / "run.json").write_text(run.replace(old, str(recording)).replace("truncated", TEXT), encoding="utf-8")
    write_report(tmp_path / "page.html", summarise(Results(mine), None))
    viewer = Viewer(mine, Replay(mine), open_recording(recording))
    with make_server(viewer) as server, answering(server), LiveServer(LiveView(), EVIL, INTRINSICS) as live:
        for address in (tmp_path / "page.html", f"http://localhost:{server.server_port}/"):
            watched = Watched(launched, strict=True)
            watched.open(address)
            assert watched.page.locator("#title").inner_text().endswith(EVIL)
            watched.page.locator("#tab-run").click()
            assert TEXT in watched.page.locator("#run").inner_text()
            assert watched.page.title().startswith(EVIL)
            assert watched.page.locator("img[src=x]").count() == 0
            assert watched.complaints == []
        watched = Watched(launched, strict=True)
        watched.page.goto(f"http://localhost:{live.port}/")
        assert watched.page.title().startswith(EVIL)
        assert watched.page.locator("img[src=x]").count() == 0
