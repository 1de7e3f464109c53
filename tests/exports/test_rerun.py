from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.results.exports import export
from cuboid.results.files import Results


def printed(path: Path, *options: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", *options, str(path)], capture_output=True, text=True, check=True
    )
    return done.stdout


def test_without_the_sdk_one_line_names_the_extra(
    run: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[rerun\]'"):
        export(run, "rerun", tmp_path / "a.rrd")
    assert not list(tmp_path.glob("*rrd*"))


def test_the_recording_has_the_tree_of_frames(run: Results, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the rerun SDK (170 MB) is not installed: pip install '.[rerun]'")
    assert export(run, "rerun", tmp_path / "a.rrd") == []
    assert not list(tmp_path.glob("*partial*"))
    text = printed(tmp_path / "a.rrd")
    for entity in (
        "world",
        "world/map",
        "world/planes/0",
        "world/objects/1",
        "world/objects/2",
        "world/objects/3",
        "world/camera",
        "world/camera_path",
        "world/camera/image",
        "world/camera/image/objects",
    ):
        assert f" /{entity} " in text, entity


def test_the_recording_needs_no_pictures_but_not_those_of_another(run: Results, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the rerun SDK (170 MB) is not installed: pip install '.[rerun]'")
    with pytest.raises(InputError):
        export(Results(run.folder, tmp_path / "nowhere"), "rerun", tmp_path / "a.rrd")
    (tmp_path / "recording").rename(tmp_path / "moved")
    (note,) = export(run, "rerun", tmp_path / "a.rrd")
    assert "no pictures" in note
