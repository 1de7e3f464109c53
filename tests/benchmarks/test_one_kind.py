"""The figures of scenes of one kind, and the digest by which benchmarks keep results."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from one_kind import height_m
from scenes import SOURCE, source_digest


def test_the_height_of_a_box_is_its_extent_upwards() -> None:
    up = np.array([0.0, 0.0, 1.0])
    size = np.array([0.3, 0.2, 0.1])
    assert height_m(size, np.eye(3), up) == pytest.approx(0.1)
    assert height_m(size, np.eye(3), np.array([1.0, 0.0, 0.0])) == pytest.approx(0.3)
    lying = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    assert height_m(size, lying, up) == pytest.approx(0.3)
    half = np.sqrt(0.5)
    leaning = np.array([[half, 0.0, half], [0.0, 1.0, 0.0], [-half, 0.0, half]])
    assert height_m(size, leaning, up) == pytest.approx(half * 0.4)


def test_other_coefficients_are_another_program(tmp_path: Path) -> None:
    shutil.copytree(SOURCE / "method" / "objects", tmp_path / "objects")
    before = source_digest(source=tmp_path)
    assert source_digest(source=tmp_path) == before
    (tmp_path / "objects" / "objectness.json").write_text("{}", encoding="utf-8")
    assert source_digest(source=tmp_path) != before
