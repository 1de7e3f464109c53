"""Objects of a scene found by a text: by pictures that the scene keeps, or by the views of a run."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

pytest.importorskip("tokenizers")

from made_scene import THINGS, Shown, change, record

from cuboid import cli
from cuboid.method.text_search import Embeddings, TextModel
from cuboid.runs.scene import Scene
from cuboid.runs.scene.checking import problems
from cuboid.runs.scene.viewing import scene_viewer


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first thing is magenta, the second pink."""
    path = tmp_path_factory.mktemp("scene") / "made.cuboid"
    record(path, Shown(frames=24))
    return path


def thing(item) -> int:
    """The number of the thing that stands where an object does."""
    return min(range(len(THINGS)), key=lambda k: float(((THINGS[k].center - item.box.center) ** 2).sum()))


def test_objects_are_ranked_by_their_pictures_which_are_embedded_once(
    path: Path, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Scene.open(path) as scene:
        found = scene.find("green", model)
        assert [thing(item) for item, _ in found] == [1, 0]  # magenta has no green at all
        assert found[0].score > found[1].score
    assert problems(path) == []

    def embed(*_: object) -> None:
        raise AssertionError("embedded again")

    monkeypatch.setattr(TextModel, "embed_pictures", embed)
    with Scene.open(path) as scene:
        again = scene.find("green", model)
        assert [item.label for item, _ in again] == [item.label for item, _ in found]
        assert [score for _, score in again] == [pytest.approx(score) for _, score in found]


def test_a_new_picture_is_embedded_anew(path: Path, model: Path) -> None:
    with Scene.open(path) as scene:
        first = {item.label: score for item, score in scene.find("green", model)}
        pictures = {label: scene.picture(label) for label in first}
    one, two = first
    change(path, "UPDATE objects SET picture = ? WHERE label = ?", pictures[one], two)
    with Scene.open(path) as scene:
        again = {item.label: score for item, score in scene.find("green", model)}
    assert again[one] == pytest.approx(first[one])
    assert again[two] == pytest.approx(first[one], abs=1e-6)


def test_vectors_of_a_run_come_before_those_of_pictures(path: Path, model: Path) -> None:
    opened = TextModel(model)
    with Scene.open(path) as scene:
        scene.find("green", model)
        labels = [item.label for item in scene.objects]
        vectors = dict(zip(labels, (opened.query(text).vector for text in ("red", "blue")), strict=True))
        scene.keep_vectors(Embeddings(opened.identity, vectors))
        assert [item.label for item, _ in scene.find("red", opened)] == labels
        assert [item.label for item, _ in scene.find("blue", opened)] == labels[::-1]


def test_while_another_one_writes_the_scene_it_is_asked_all_the_same(path: Path, model: Path) -> None:
    with Scene.open(path) as writing:
        writing.name(1, "mine")
        with Scene.open(path) as scene:
            assert len(scene.find("green", model)) == len(THINGS)


def test_damaged_vectors_are_told(path: Path, model: Path) -> None:
    with Scene.open(path) as scene:
        scene.find("green", model)
    change(path, "UPDATE embeddings SET picture = -5")
    assert any("embeddings.picture is damaged" in line for line in problems(path))


def test_the_command_lists_the_best(path: Path, model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["scene", "find", str(path), "--text", "green", "--text-model", str(model)]
    assert cli.main([*words, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["objects"]
    assert [row["text_score"] for row in rows] == sorted((row["text_score"] for row in rows), reverse=True)
    assert cli.main([*words, "--limit", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["objects"] == rows[:1]
    assert cli.main(words) == 0
    assert "text score" in capsys.readouterr().out
    assert cli.main(["scene", "find", str(path), "--text", "green"]) == 2
    assert "name its folder, or set CUBOID_TEXT_MODEL" in capsys.readouterr().err


def test_the_page_of_a_scene_ranks_its_objects(path: Path, model: Path, tmp_path: Path) -> None:
    viewer = scene_viewer(path, tmp_path / "work", model=TextModel(model))
    with Scene.open(path) as scene:
        expected = [item.label for item, _ in scene.find("green", model)]
    assert [label for label, _ in viewer.fits("green")] == expected
    assert b'"text":"/text"' in viewer.page


def test_a_run_leaves_its_vectors_in_results_and_scene(tmp_path: Path, model: Path) -> None:
    recording, output, scene = (str(tmp_path / name) for name in ("table", "results", "kitchen.cuboid"))
    size = ("--frames", "24", "--size", "160x120", "--sensor", "clean", "--workers", "1")
    assert cli.main(["synth", *size, "--output", recording]) == 0
    words = ["track", recording, "--output", output, "--scene", scene]
    assert cli.main([*words, "--text-model", str(model)]) == 0
    kept = Embeddings.read(tmp_path / "results" / "embeddings.npz").vectors
    assert kept
    with sqlite3.connect(scene) as connection:
        rows = connection.execute("SELECT label, picture FROM embeddings").fetchall()
    assert sorted(rows) == [(label, None) for label in sorted(kept)]
    assert cli.main([*words[:3], str(tmp_path / "other"), "--text-model", str(tmp_path)]) == 2
    assert not (tmp_path / "other").exists()  # refused before the work
    assert cli.main([*words[:4], "--force"]) == 0
    assert not (tmp_path / "results" / "embeddings.npz").exists()  # of the results that were replaced
