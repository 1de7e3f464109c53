"""Which recordings the words of a call mean."""

from __future__ import annotations

from pathlib import Path

import fsspec
import pytest

from cuboid.fleet.batch.sources import expand
from cuboid.ground.core.errors import InputError
from fakes import write_recording


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings, one of them in a folder of its own, and two folders without any."""
    write_recording(tmp_path / "all" / "desk", 2)
    write_recording(tmp_path / "all" / "kitchen" / "seq-1", 2)
    (tmp_path / "all" / "empty").mkdir()
    for name in ("broken", "other"):
        (tmp_path / "all" / name / "color").mkdir(parents=True)
    return tmp_path / "all"


def test_a_folder_and_its_entries_one_by_one_mean_the_same(folder: Path) -> None:
    found = expand([str(folder)])
    assert [source.name for source in found] == ["broken", "desk", "empty", "kitchen/seq-1", "other"]
    assert expand(map(str, sorted(folder.iterdir()))) == found


def test_a_folder_without_a_recording_stops_a_batch_only_alone(folder: Path) -> None:
    with pytest.raises(InputError, match="holds no recordings"):
        expand([str(folder / "empty")])
    with pytest.raises(InputError, match="nowhere does not exist"):
        expand([str(folder / "desk"), "nowhere"])


@pytest.mark.parametrize("start", ["", "file://", "memory://"])
def test_other_files_that_match_a_glob_are_no_recordings(folder: Path, start: str) -> None:
    for name in ("notes.txt", "README.md", "walk.bag"):
        (folder / name).write_text("of Monday\n")
    if start == "memory://":
        memory = fsspec.filesystem("memory")
        memory.put(str(folder), "/all", recursive=True)
        folder = Path("/all")
    names = [source.name for source in expand([f"{start}{folder}/*"])]
    assert names == ["broken", "desk", "empty", "kitchen", "other", "walk.bag"]
    with pytest.raises(InputError, match="no folder and no file of a recording matches"):
        expand([f"{start}{folder}/*.txt"])


def test_a_broken_recording_beside_good_ones_is_not_left_out(folder: Path) -> None:
    (folder / "kitchen" / "seq-2").mkdir()
    found = expand([str(folder / "desk"), str(folder / "kitchen")])
    assert [source.name for source in found] == ["desk", "kitchen/seq-1", "kitchen/seq-2"]
