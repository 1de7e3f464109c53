"""`cuboid measure` on parcels under a fixed camera."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from called import called
from cuboid.cli import main
from made_parcels import SIDES_M, UNITS_PER_M, write_parcels


@pytest.fixture(scope="module")
def parcels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("measure") / "parcels"
    write_parcels(folder)
    return folder


def measured(capfd: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    assert main(["measure", *map(str, words), "--json"]) == 0
    document: dict[str, Any] = json.loads(capfd.readouterr().out)
    return document


def test_each_parcel_gets_its_sides_and_an_interval_that_holds_them(
    parcels: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    found = measured(capfd, parcels)["objects"]
    expected = sorted(SIDES_M, key=lambda sides: sides[2])
    assert len(found) == len(expected)
    for one, true in zip(sorted(found, key=lambda one: one["size_m"][2]), expected, strict=True):
        np.testing.assert_allclose(one["size_m"], true, atol=0.004)
        assert (np.abs(np.subtract(one["size_m"], true)) <= one["size_within_m"]).all()
        assert one["sides_seen"] == ["+z"]
        assert one["box_volume_m3"] == pytest.approx(np.prod(true), rel=0.1)
        assert max(one["size_within_m"]) < 0.02
        assert max(one["center_sigma_m"]) < 0.01


def test_lines_and_the_picture_are_in_the_chosen_unit(
    parcels: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "dimensions.png"
    assert main(["measure", str(parcels), "--units", "cm", "--picture", str(picture)]) == 0
    lines = [line for line in capfd.readouterr().out.splitlines() if line.startswith("#")]
    assert len(lines) == 3
    side = r"\d+\.\d\d"
    assert all(
        re.match(rf"#\d+: {side} x {side} x {side} cm ± {side} x {side} x {side}, box volume \d", line)
        for line in lines
    )
    assert any(re.search(r", box volume \d\.\d\d l, \d\.\d\d cm off the shape of a box$", line) for line in lines)
    drawn, plain = cv2.imread(str(picture)), cv2.imread(str(parcels / "color" / "000023.jpg"))
    assert drawn.shape == plain.shape
    assert np.count_nonzero(np.abs(drawn.astype(int) - plain).max(2) > 60) > 1000  # lines and numbers


def test_a_fixed_camera_needs_no_texture(parcels: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    plain = tmp_path / "plain"
    shutil.copytree(parcels, plain)
    gray = np.full_like(cv2.imread(str(parcels / "color" / "000000.jpg")), 120)
    for file in (plain / "color").iterdir():
        cv2.imwrite(str(file), gray)
    assert main(["measure", str(plain)]) == 2
    assert "no camera pose can be estimated" in capfd.readouterr().err
    found = measured(capfd, plain, "--fixed")["objects"]
    sides = sorted(one["size_m"] for one in found)
    np.testing.assert_allclose(sides, sorted(map(list, SIDES_M)), atol=0.004)
    assert main(["measure", str(plain), "--fixed", "--poses", "estimated"]) == 2
    assert "leave out --poses" in capfd.readouterr().err


def test_a_known_box_gives_the_error_of_scale_and_corrects_the_camera(
    parcels: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    wrong, camera = UNITS_PER_M / 1.06, tmp_path / "camera.json"
    words = (parcels, "--known", "100x200x150mm")
    scale = measured(capfd, *words, "--depth-scale", wrong, "--output", camera)["scale"]
    assert scale["measured"] == pytest.approx(1.06, abs=0.015)
    assert json.loads(camera.read_text())["depth_units_per_metre"] == pytest.approx(UNITS_PER_M, rel=0.015)
    assert measured(capfd, *words, "--intrinsics", camera)["scale"]["measured"] == pytest.approx(1.0, abs=0.015)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--known", "200x150mm"], "expected three sides and a unit such as 200x150x100mm, got '200x150mm'"),
        (["--known", "900x900x900mm"], "no object is within 15% of the known 900 x 900 x 900 mm; measured: #"),
        (["--output", "camera.json"], "it needs --known"),
        (["--picture", "picture.txt"], "must be a .png or .jpg file"),
    ],
)
def test_a_mistake_is_one_line(parcels: Path, words: list[str], message: str) -> None:
    done = called("measure", parcels, *words)
    assert done.returncode == 2
    assert message in done.stderr


def test_one_picture_says_what_is_missing(parcels: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    single = tmp_path / "single"
    for folder, ending in (("color", "jpg"), ("depth", "png")):
        (single / folder).mkdir(parents=True)
        shutil.copy(parcels / folder / f"000000.{ending}", single / folder)
    shutil.copy(parcels / "camera.json", single)
    assert main(["measure", str(single)]) == 0, "one picture is enough for the parcels"
    flat = np.tile(np.linspace(900, 700, 480).astype(np.uint16)[:, None], (1, 640))
    cv2.imwrite(str(single / "depth" / "000000.png"), cv2.resize(flat, _size_of(single)))
    capfd.readouterr()
    assert main(["measure", str(single)]) == 2
    assert "nothing was measured in 1 frame: an object is measured once it was seen clearly" in capfd.readouterr().err


def _size_of(recording: Path) -> tuple[int, int]:
    height, width = cv2.imread(str(recording / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED).shape
    return width, height
