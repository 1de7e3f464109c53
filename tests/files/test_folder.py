from __future__ import annotations

import errno
from pathlib import Path

import pytest

from cuboid.ground.core.errors import OutputError
from cuboid.ground.formats.folder import ResultFolder, writing


def fill(folder: ResultFolder, *names: str) -> None:
    for name in names:
        folder.file(name).write_text("new")


def test_a_new_folder_appears_only_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "out"
    with ResultFolder(path) as folder:
        fill(folder, "objects.json")
        assert not path.exists()
        folder.commit()
    assert [file.name for file in path.iterdir()] == ["objects.json"]
    assert [file.name for file in path.parent.iterdir()] == ["out"]


def test_an_existing_folder_is_refused_even_when_it_is_empty(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="the output folder exists; --force"):
        ResultFolder(tmp_path)


def test_a_file_is_refused_even_with_force(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("precious")
    with pytest.raises(OutputError, match="is a file"):
        ResultFolder(tmp_path / "out", force=True)
    assert (tmp_path / "out").read_text() == "precious"


def test_force_replaces_our_files_and_no_others(tmp_path: Path) -> None:
    for name in ("run.json", "objects.json", "labelled.mp4", "notes.txt"):
        (tmp_path / name).write_text("old")
    with ResultFolder(tmp_path, force=True) as folder:
        fill(folder, "run.json", "objects.json")
        assert (tmp_path / "objects.json").read_text() == "old"
        folder.commit()
    contents = {file.name: file.read_text() for file in tmp_path.iterdir()}
    assert contents == {"run.json": "new", "objects.json": "new", "notes.txt": "old"}


def test_force_keeps_old_results_when_the_run_fails(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("old")
    folder = ResultFolder(tmp_path, force=True)
    fill(folder, "run.json")
    folder.__exit__(None, None, None)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"run.json": "old"}


def test_run_json_is_absent_while_results_are_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.json").write_text("old")
    present: list[tuple[str, bool]] = []
    replace = Path.replace

    def watched(self: Path, target: Path) -> Path:
        present.append((self.name, (tmp_path / "run.json").exists()))
        return replace(self, target)

    with ResultFolder(tmp_path, force=True) as folder:
        fill(folder, "run.json", "tracks.csv", "objects.json")
        monkeypatch.setattr(Path, "replace", watched)
        folder.commit()
    assert [there for _, there in present] == [False] * 3
    assert present[-1][0] == "run.json"


def test_a_folder_that_comes_into_being_meanwhile_is_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "out"
    with ResultFolder(path) as folder:
        fill(folder, "objects.json")
        path.mkdir()
        (path / "theirs").write_text("x")
        with pytest.raises(OutputError, match="out: the output folder came into being during the run, and is not"):
            folder.commit()
    assert [file.name for file in path.iterdir()] == ["theirs"]


def test_with_force_a_folder_that_comes_into_being_meanwhile_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "out"
    with ResultFolder(path, force=True) as second:
        with ResultFolder(path, force=True) as first:
            fill(first, "run.json", "map.ply")
            first.commit()
        fill(second, "run.json", "objects.json")
        (path / "theirs").write_text("x")
        second.commit()
    assert sorted(file.name for file in path.iterdir()) == ["objects.json", "run.json", "theirs"]


def test_a_second_run_into_one_folder_is_refused_before_it_works(tmp_path: Path) -> None:
    path = tmp_path / "out"
    with ResultFolder(path) as first:
        with pytest.raises(OutputError, match="out: another run is writing this folder; name another output folder"):
            ResultFolder(path)
        fill(first, "run.json")
        first.commit()
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_what_a_killed_run_left_is_no_run(tmp_path: Path) -> None:
    (tmp_path / ".out.01234567.partial").mkdir()
    with ResultFolder(tmp_path / "out") as folder:
        folder.commit()


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/out: cannot be written: File exists"):
        ResultFolder(tmp_path / "file" / "out")


def test_a_full_disk_is_called_by_its_name() -> None:
    with (
        pytest.raises(OutputError, match=r"tracks.csv: cannot be written: the disk is full"),
        writing(Path("hidden"), Path("out/tracks.csv")),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
