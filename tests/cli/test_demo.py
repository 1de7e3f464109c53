from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from called import called
from cuboid.results.files import read_objects, read_run


def demo(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return called("demo", *words)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a short demo, and what it printed."""
    output = tmp_path_factory.mktemp("demo") / "demo"
    done = demo("--output", output, "--frames", "24")
    assert done.returncode == 0, done.stderr
    return output, done.stdout


def test_the_demo_finds_objects_and_shows_them(made: tuple[Path, str]) -> None:
    output, printed = made
    run = read_run(output / "results" / "run.json")
    assert (run.frames_used, run.complete, run.format) == (24, True, "plain")
    assert (output / "results" / "labelled.mp4").stat().st_size > 10_000
    objects = read_objects(output / "results" / "objects.json").objects
    assert len(objects) >= 4
    assert all(any(line.split()[:1] == [str(item.label)] for line in printed.splitlines()) for item in objects)


def test_a_second_demo_takes_the_place_of_the_first(made: tuple[Path, str]) -> None:
    output, _ = made
    (output / "results" / "mine.txt").write_text("x")
    done = demo("--output", output, "--frames", "12", "--no-video", "--json")
    assert done.returncode == 0, done.stderr
    assert {"output", "objects", "run", "evaluation"} <= json.loads(done.stdout).keys()
    assert read_run(output / "results" / "run.json").frames_used == 12
    assert not (output / "results" / "labelled.mp4").exists()
    assert (output / "results" / "mine.txt").exists()


def test_a_folder_that_is_no_demo_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "recording").mkdir()
    (tmp_path / "recording" / "mine.txt").write_text("x")
    done = demo("--output", tmp_path, "--frames", "12")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "no demo has made it" in done.stderr
    assert (tmp_path / "recording" / "mine.txt").read_text() == "x"
