"""`cuboid view` of a scene: its objects, what changed, and names that the scene keeps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from made_scene import THINGS, Shown, record

from browser import OpenPage, rect
from cuboid.ground.core.errors import InputError
from cuboid.runs.scene import Scene
from cuboid.runs.scene.viewing import scene_viewer


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of two things; the second recording shows one of them at another place."""
    path = tmp_path_factory.mktemp("scene") / "made.cuboid"
    record(path, Shown(frames=24))
    record(path, Shown(THINGS[:1], frames=50), "again")
    return path


def document(page: bytes) -> dict[str, Any]:
    return json.loads(page.decode().split('id="data">')[1].split("</script>")[0])


def test_the_page_of_a_scene_shows_its_objects_and_what_changed(path: Path, tmp_path: Path) -> None:
    shown = document(scene_viewer(path, tmp_path / "work").page)
    with Scene.open(path) as scene:
        labels = [item.label for item in scene.objects]
        assert [item["label"] for item in shown["objects"]] == labels
        assert [(one["label"], one["change"]) for one in shown["changes"]] == [
            (one.label, one.change) for one in scene.shown_changes(2)
        ]
    assert [one["change"] for one in shown["changes"]] == ["gone"]
    assert shown["changes"][0]["before"].startswith("data:image/jpeg")
    assert shown["objects"][0]["picture"]["address"].startswith("data:image/jpeg")  # the recording is nowhere
    assert "pictures" not in shown["live"]


def test_names_given_in_the_page_are_kept_by_the_scene(path: Path, tmp_path: Path) -> None:
    viewer = scene_viewer(path, tmp_path / "work")
    label = document(viewer.page)["objects"][0]["label"]
    assert viewer.rename(label, " big box ").name == "big box"
    with Scene.open(path) as scene:
        assert {item.label: item.name for item in scene.objects}[label] == "big box"
    assert document(viewer.page)["objects"][0]["name"] == "big box"
    with pytest.raises(InputError, match="no object has the label 77"):
        viewer.rename(77, "x")
    with pytest.raises(InputError, match="a name is one line"):
        viewer.rename(label, "a\nb")


def test_what_cannot_be_shown_is_one_line(path: Path, tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("no scene")
    with pytest.raises(InputError, match=r"note\.txt"):
        scene_viewer(tmp_path / "note.txt", tmp_path / "a")
    with pytest.raises(InputError, match="unknown format"):
        scene_viewer(path, tmp_path / "b", tmp_path / "nowhere")


@pytest.mark.parametrize("width", [1280, 390])
def test_before_and_after_of_a_change_are_shown_side_by_side(
    open_page: OpenPage, path: Path, tmp_path: Path, width: int
) -> None:
    (tmp_path / "page.html").write_bytes(scene_viewer(path, tmp_path / "work").page)
    page = open_page(tmp_path / "page.html", width=width)
    page.click("#changes .pair")
    assert page.locator("#compare-title").inner_text().split() == ["#1", "gone"]
    assert page.locator("#compare figcaption").all_inner_texts() == ["before", "after"]
    assert page.locator("#compare img").evaluate("image => image.decode().then(() => image.naturalWidth)") > 10
    assert page.inner_text("#compare .empty") == "gone"
    before, after = map(rect, page.locator("#compare figure").all())
    assert before["y"] == after["y"]
    assert before["x"] + before["width"] <= after["x"]
    assert after["x"] + after["width"] <= width
    page.keyboard.press("Escape")
    assert page.locator("#compare").is_hidden()
    page.click("#changes .pair")
    page.click("#compare .close")
    assert page.locator("#compare").is_hidden()
