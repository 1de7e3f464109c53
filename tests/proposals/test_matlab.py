"""MATLAB files that crash, hang or fill the memory of what reads them are refused in one line, and the next is read."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from cuboid.ground.core.errors import InputError
from cuboid.method.proposals import matlab
from cuboid.method.proposals.files import load_mat
from cuboid.method.proposals.matlab import MatlabReader

# Stands in for the child: does what a bad file can make it do.
CHILD = """
import json, os, sys, time
for line in sys.stdin:
    name = json.loads(line)
    if "crash" in name:
        os.abort()
    if "hang" in name:
        time.sleep(60)
    if "cut" in name:
        print(json.dumps({"names": ["a"], "arrays": [["a", "<f8", [100]]]}), flush=True)
        os._exit(0)
    print(json.dumps({"names": ["a"], "arrays": []}), flush=True)
"""


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MatlabReader:
    (tmp_path / "child.py").write_text(CHILD)
    for name in ("crash.mat", "hang.mat", "cut.mat", "good.mat"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.setattr(matlab, "CHILD", tmp_path / "child.py")
    monkeypatch.setattr(matlab, "MATLAB_TIMEOUT_S", 1.5)
    return MatlabReader()


@pytest.mark.parametrize(("name", "why"), [("crash", "crashed"), ("hang", "took too long"), ("cut", "crashed")])
def test_what_its_reader_does_not_survive_is_one_line(
    reader: MatlabReader, tmp_path: Path, name: str, why: str
) -> None:
    try:
        assert reader.read(tmp_path / "good.mat") == ({}, ["a"])
        with pytest.raises(InputError, match=f"{name}.mat cannot be read: its reader {why}"):
            reader.read(tmp_path / f"{name}.mat")
        assert reader.read(tmp_path / "good.mat") == ({}, ["a"])
    finally:
        reader.close()


def test_one_process_reads_many_files_and_another_after_a_crash(tmp_path: Path) -> None:
    boxes = np.array([[1, 2, 20, 30], [5, 5, 40, 60]])
    for k in range(3):
        savemat(tmp_path / f"{k}.mat", {"bboxes": boxes, "bboxes_scores": np.array([[0.5], [0.9]])})
    found = [load_mat(tmp_path / f"{k}.mat", 64, 48) for k in range(3)]
    assert all(one.boxes_xyxy.tolist() == [[4, 4, 60, 40], [1, 0, 30, 20]] for one in found)
    first = matlab.READER._process
    assert first is not None
    os.kill(first.pid, 9)
    first.wait()
    assert len(load_mat(tmp_path / "0.mat", 64, 48)) == 2
    assert matlab.READER._process is not first


def test_a_file_that_takes_all_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zeros of 130 MB, in a file of a hundredth of it."""
    small = matlab.CHILD.read_text().replace("MAX_MEMORY = 1 << 30", "MAX_MEMORY = 128 << 20")
    (tmp_path / "child.py").write_text(small)
    monkeypatch.setattr(matlab, "CHILD", tmp_path / "child.py")
    path = tmp_path / "0.mat"
    savemat(path, {"bboxes": np.zeros((4000, 4000)), "bboxes_scores": np.zeros((1, 1))}, do_compression=True)
    assert path.stat().st_size < 2 << 20
    reader = MatlabReader()
    try:
        with pytest.raises(InputError, match="it takes more than 128 MB of memory"):
            reader.read(path)
    finally:
        reader.close()
