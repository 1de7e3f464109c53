"""The pictures of the documentation can be made anew."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from cuboid import cli
from cuboid.method.surfaces.kernels.outlines import FREE, SUPPORT

SCRIPT = Path(__file__).resolve().parents[2] / "docs" / "make_pictures.py"


def test_the_picture_of_the_method_shows_free_space_and_support_around_segments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = importlib.util.spec_from_file_location("make_pictures", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    pictures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(pictures)
    assert cli.main(["demo", "--frames", "5", "--no-video", "--output", str(tmp_path / "demo")]) == 0
    monkeypatch.setattr(pictures, "SHOWN", 4)
    picture = pictures.method_picture(tmp_path / "demo")
    width, height = pictures.PANEL
    assert picture.shape == (2 * height, 2 * width, 3)
    segments = picture[height + 30 : -30, :width].astype(int)
    for kind, _, color in pictures.BOUNDS:
        if kind in (FREE, SUPPORT):
            assert (np.abs(segments - color).max(2) < 40).sum() > 100
