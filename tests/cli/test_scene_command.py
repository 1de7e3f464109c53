"""`cuboid scene`: what it prints, changes and refuses."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

from cuboid.cli import main
from cuboid.results.files import Results
from cuboid.runs.scene import Scene

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scene"))
from made_scene import THINGS, Shown, record


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "made.cuboid"
    record(path, Shown(frames=24))
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(made, tmp_path / "kitchen.cuboid"))


def said(capsys: pytest.CaptureFixture[str], *words: object, status: int = 0) -> str:
    assert main(["scene", *map(str, words)]) == status
    out = capsys.readouterr()
    return out.out + out.err


def test_objects_are_listed_with_their_names(path, capsys):
    assert "#2 blue, [mug]" in said(capsys, "name", path, 2, "blue, [mug]")
    listed = said(capsys, "list", path)
    assert "blue, [mug]" in listed
    assert [line.split()[0] for line in listed.splitlines()[3:5]] == ["1", "2"]
    assert "/made" in said(capsys, "show", path)
    shown = said(capsys, "show", path, 2, "--picture", path.with_name("mug.jpg"))
    assert "#2 blue, [mug]: present" in shown
    assert "recording 1: frames" in shown
    assert path.with_name("mug.jpg").read_bytes()[:2] == b"\xff\xd8"


def test_names_are_in_exports_and_results(path, tmp_path, capsys):
    said(capsys, "name", path, 1, 'a "big", box')
    said(capsys, "export", path, "--to", "csv", "--output", tmp_path / "o.csv")
    assert (tmp_path / "o.csv").read_text().splitlines()[1].endswith(',"a ""big"", box"')
    said(capsys, "export", path, "--to", "results", "--output", tmp_path / "results")
    assert Results(tmp_path / "results").found.objects[0].name == 'a "big", box'
    page = (tmp_path / "results" / "report.html").read_text()
    assert r"a \"big\", box" in page


def test_changes_are_told(path, tmp_path, capsys):
    assert "nothing changed" in said(capsys, "changes", path)
    with Scene.open(path) as scene:
        label = scene.near(THINGS[1].center, 0.1)[0].label
    record(path, Shown(THINGS[:1], frames=50), "again")
    told = said(capsys, "changes", path, "--pictures", tmp_path / "pictures")
    assert "gone" in told
    assert [file.name for file in (tmp_path / "pictures").iterdir()] == [f"recording-2-label-{label}-before.jpg"]
    assert "unchanged" in said(capsys, "changes", path, "--all")


def test_objects_are_merged_and_forgotten(path, capsys):
    assert "#1 and #2 are now #1" in said(capsys, "merge", path, 1, 2)
    assert "merged into 1" in said(capsys, "list", path, "--all")
    assert "#1 is forgotten" in said(capsys, "forget", path, 1)
    assert "no object" in said(capsys, "list", path)
    assert Scene.open(path).objects == []


def test_files_are_checked_and_compacted(path, tmp_path, capsys):
    assert "no damage found" in said(capsys, "check", path)
    assert "became" in said(capsys, "compact", path)
    data = bytearray(path.read_bytes())
    data[8192:20000] = bytes(11808)
    path.write_bytes(bytes(data))
    assert "no damage found" not in said(capsys, "check", path, status=2)
    assert "the readable part is in" in said(capsys, "check", path, "--rescue", tmp_path / "new.cuboid")
    assert "no damage found" in said(capsys, "check", tmp_path / "new.cuboid")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("list", "none.cuboid"), "there is no such scene file"),
        (("show", "PATH", "9"), "no object has the label 9"),
        (("name", "PATH", "9", "x"), "no object has the label 9"),
        (("export", "PATH", "--to", "csv", "--output", "o.csv", "--recording", "4"), "there is no recording 4"),
        (("changes", "PATH", "--since", "today"), "expected a date"),
    ],
)
def test_mistakes_are_one_line(path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(path.parent)
    line = said(capsys, *(str(path) if word == "PATH" else word for word in words), status=2)
    assert message in line
    assert len(line.splitlines()) == 1


def test_each_verb_gives_json(path, tmp_path, capsys):
    def given(*words):
        return json.loads(said(capsys, *words, "--json"))

    listed = given("list", path)["objects"]
    assert [(item["label"], item["state"], item["merged_into"]) for item in listed] == [
        (1, "present", None),
        (2, "present", None),
    ]
    with Scene.open(path) as scene:
        for item, own in zip(listed, scene.objects, strict=True):
            assert item["center"] == pytest.approx(own.box.center, abs=1e-6)
            assert item["rotation"] == pytest.approx(own.box.rotation, abs=1e-6)
            assert tuple(item["last_seen"].values()) == own.last_seen
    (one,) = given("show", path)["recordings"]
    assert (one["number"], one["frames"], one["complete"]) == (1, 24, True)
    assert given("show", path, 2)["object"] == listed[1]
    assert given("changes", path) == {"changes": []}
    assert given("name", path, 2, " mug ") == {"label": 2, "name": "mug"}
    exported = given("export", path, "--to", "csv", "-o", tmp_path / "o.csv")
    assert exported == {"output": str(tmp_path / "o.csv"), "form": "csv", "notes": []}
    assert given("merge", path, 1, 2) == {"label": 1, "merged": [1, 2]}
    assert given("forget", path, 1) == {"forgotten": 1}
    assert given("list", path) == {"objects": []}
    assert given("check", path) == {"problems": []}
    assert set(given("compact", path)) == {"bytes_before", "bytes_after"}


def test_figures_in_a_file_are_replaced_with_force_only(path, tmp_path, capsys):
    file = tmp_path / "objects.json"
    assert f"all figures in {file}" in said(capsys, "list", path, "--json", file)
    assert f"{file}: exists; --force replaces it" in said(capsys, "list", path, "--json", file, status=2)
    said(capsys, "name", path, 1, "box")
    said(capsys, "list", path, "--json", file, "--force")
    assert json.loads(file.read_text())["objects"][0]["name"] == "box"
