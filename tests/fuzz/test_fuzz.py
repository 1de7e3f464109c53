"""A short run of each fuzzer, and every input that once failed. ``run.py`` beside this runs for long."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest
from changes import kept
from containers import CONTAINERS, NEEDS
from engine import Outcome, as_before, fault_of, fuzz, quiet_libraries, try_changes
from scene_files import SCENES
from store_files import STORES
from targets import TARGETS

HERE = Path(__file__).resolve().parent
# 1,300 in all; one call each, drawn at random, of targets that have many.
INPUTS = {
    "plain": 120, "tum": 120, "7-scenes": 120, "uw-rgbd-scenes-v2": 120, "results": 180, "truth": 180,
    "proposals": 100, "meshes": 50, "scenes": 20, "stores": 12,
    "scannet-sens": 20, "open3d": 10, "nerfstudio": 10, "3rscan": 20, "infinitam": 30, "sun3d": 8, "arkitscenes": 8,
    "icl-nuim": 4, "bonn": 4, "record3d-file": 40, "plain zip": 40, "plain tar": 40, "ros-bag bag": 10,
    "ros-bag mcap": 8, "gravity": 10,
}  # fmt: skip
# With so many inputs, some must have been refused.
MANY = 50
SEED = 20_261_122
ALL = TARGETS | SCENES | CONTAINERS | STORES


@pytest.fixture(scope="module", autouse=True)
def quiet() -> None:
    quiet_libraries()


@pytest.mark.parametrize("name", INPUTS)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    outcome = fuzz(ALL[name], tmp_path, INPUTS[name], SEED, calls_each=1 if name in TARGETS | SCENES else None)
    assert outcome.faults == {}
    if INPUTS[name] >= MANY:
        assert outcome.refused > INPUTS[name] / 50, "hardly anything that was done to the files mattered"


def test_what_once_failed_does_not(tmp_path: Path) -> None:
    cases = sorted((HERE / "kept").glob("*.json"))
    assert cases
    for case in cases:
        name, changes = kept(case)
        if name in NEEDS and find_spec(NEEDS[name]) is None:
            continue
        target, outcome = ALL[name], Outcome()
        (tmp_path / case.stem).mkdir()
        target.make(tmp_path / case.stem)
        try_changes(target, tmp_path / case.stem, changes, sorted(target.calls), outcome)
        assert outcome.faults == {}, case.name


def test_good_files_are_not_refused(tmp_path: Path) -> None:
    for name in (*TARGETS, *SCENES, "plain", "tum", "7-scenes", "uw-rgbd-scenes-v2"):
        target = ALL[name]
        folder = tmp_path / name
        folder.mkdir()
        target.make(folder)
        for call in target.calls.values():
            with as_before(target, folder):
                assert fault_of(call, folder) == ("", False), name
