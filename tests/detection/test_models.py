"""Models are fetched from a server on this machine: resumed, checked, and refused where they are others."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from cuboid.cli import main
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.method.detection import models
from cuboid.method.detection.fetching import fetch
from cuboid.method.detection.models import MODELS, Model, models_folder

# A file of a release, or of one revision: a branch may change.
PUBLISHED = re.compile(
    r"https://(github\.com/[^/]+/[^/]+/releases/download|huggingface\.co/[^/]+/[^/]+/resolve/[0-9a-f]{40})/"
)
CONTENT = bytes(range(256)) * 4096  # a megabyte


class Server(ThreadingHTTPServer):
    """Serves CONTENT; `most` bytes of it at a time, then it hangs up; from the middle where `ranges`."""

    most: int | None = None
    ranges = True
    content = CONTENT
    asked: list[str | None]  # the ranges


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        asked = self.headers.get("Range")
        self.server.asked.append(asked)
        if self.path != "/model.onnx":
            self.send_error(404)
            return
        content, begin = self.server.content, 0
        if asked and self.server.ranges:
            begin = int(asked.removeprefix("bytes=").rstrip("-"))
            self.send_response(206)
        else:
            self.send_response(200)
        self.send_header("Content-Length", str(len(content) - begin))
        self.end_headers()
        end = len(content) if self.server.most is None else begin + self.server.most
        self.wfile.write(content[begin:end])

    def log_message(self, *args: object) -> None:
        """Say nothing."""


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Server]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setenv("CUBOID_MODELS", str(tmp_path / "models"))
    made = Server(("127.0.0.1", 0), Handler)
    made.asked = []
    threading.Thread(target=made.serve_forever, daemon=True).start()
    yield made
    made.shutdown()
    made.server_close()


def offered(server: Server, path: str = "/model.onnx", content: bytes = CONTENT) -> Model:
    url = f"http://127.0.0.1:{server.server_address[1]}{path}"
    return Model("made", url, hashlib.sha256(content).hexdigest(), len(content), "MIT", "nobody", "a made one")


def test_a_model_is_fetched_once(server: Server) -> None:
    model, told = offered(server), []  # type: ignore[var-annotated]
    path = fetch(model, lambda done, total: told.append((done, total)))
    assert path == models_folder() / "made.onnx"
    assert path.read_bytes() == CONTENT
    assert told[-1] == (len(CONTENT), len(CONTENT))
    assert fetch(model) == path
    assert server.asked == [None]
    assert [one.name for one in path.parent.iterdir()] == ["made.onnx"]


@pytest.mark.parametrize("ranges", [True, False])
def test_a_fetch_that_broke_off_goes_on(server: Server, ranges: bool) -> None:
    model = offered(server)
    server.most = 300_000
    with pytest.raises(InputError, match=r"cannot be fetched: .*the same call goes on from there"):
        fetch(model)
    assert not model.path.exists()
    server.most, server.ranges = None, ranges
    assert fetch(model).read_bytes() == CONTENT
    assert server.asked == [None, "bytes=300000-"]


def test_another_file_is_refused_and_not_kept(server: Server) -> None:
    model = offered(server)
    for content in (CONTENT[::-1], CONTENT + b"more"):
        server.content = content
        with pytest.raises(InputError, match="is not the file that was published: its sha256 is"):
            fetch(offered(server, content=CONTENT[:-1] + b"x"))
        assert list(model.path.parent.iterdir()) == []


def test_a_kept_file_that_was_changed_is_fetched_again(server: Server) -> None:
    model = offered(server)
    fetch(model).write_bytes(b"changed")
    assert fetch(model).read_bytes() == CONTENT


def test_servers_that_have_no_model(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"/other\.onnx: cannot be fetched: Not Found"):
        fetch(offered(server, "/other.onnx"))
    server.shutdown()
    server.server_close()
    with pytest.raises(InputError, match="cannot be fetched"):
        fetch(offered(server))
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CUBOID_MODELS", str(tmp_path / "file" / "models"))
    with pytest.raises(OutputError, match="cannot be written"):
        fetch(offered(server))


def test_the_command_lists_and_fetches(
    server: Server, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(MODELS, "made", offered(server))
    assert main(["models"]) == 0
    listed = capsys.readouterr().out
    assert "yolox-nano" in listed
    assert "-: not measured" in " ".join(listed.split())
    assert main(["models", "fetch", "made", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["models"]
    assert (row["license"], row["size_bytes"], row["path"]) == ("MIT", len(CONTENT), str(models_folder() / "made.onnx"))
    for words in (["fetch"], ["list", "made"], ["fetch", "nothing"]):
        assert main(["models", *words]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_what_is_listed_has_a_checksum_a_license_and_the_publishers_address() -> None:
    for model in MODELS.values():
        assert len(model.sha256) == 64
        assert model.license in ("Apache-2.0", "MIT", "BSD-3-Clause")
        assert PUBLISHED.match(model.url)
        assert model.size_bytes > 1_000_000


def test_the_folder_of_models(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CUBOID_MODELS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert models_folder() == tmp_path / "cuboid" / "models"


def test_a_folder_of_models_that_cannot_be_read_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("CUBOID_MODELS", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / ("x" * 300)))  # root may read any folder; this name is too long for one
    assert main(["models"]) == 2
    assert re.fullmatch(r"cuboid: .*cannot be read: .*; CUBOID_MODELS names another folder\n", capsys.readouterr().err)
    monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    assert main(["models"]) == 2
    said = "the home folder is unknown; CUBOID_MODELS names a folder of models"
    assert capsys.readouterr().err == f"cuboid: error: {said}\n"


def test_a_model_of_any_size_gets_the_size_that_it_was_trained_with(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CUBOID_MODELS", str(tmp_path))
    asked: list[int | None] = []
    monkeypatch.setattr(models, "OnnxDetector", lambda path, options: asked.append(options.size))
    for name in ("d-fine-n", "yolox-nano"):
        MODELS[name].path.write_bytes(b"weights")
        for options in (None, "score=0.1", "size=320"):
            models.kept_model(name, options)
    assert asked == [640, 640, 320, None, None, 320]


def test_the_list_has_a_dozen_models_with_all_their_facts(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["models"]
    assert len(rows) >= 12
    for fact in ("name", "url", "sha256"):
        assert len({row[fact] for row in rows}) == len(rows)
    assert main(["models"]) == 0
    assert "not measured" in capsys.readouterr().out
