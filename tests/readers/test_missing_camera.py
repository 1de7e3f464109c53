from __future__ import annotations

import json

import numpy as np
import pytest
from made_recordings import CAMERA, color_image, depth_image, write_image

from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.inputs.readers import FrameEntry, open_recording
from cuboid.inputs.readers.missing_camera import guess_camera


def _notes(path, **options):
    with pytest.raises(InputError) as raised:
        open_recording(path, **options)
    return str(raised.value), raised.value.__notes__


def _camera_of(notes):
    """Return the camera.json that the notes hold."""
    text = "".join(notes)
    return json.loads(text[text.index("{") : text.index("}") + 1])


def test_all_that_is_missing_is_in_one_message_with_the_file_to_write(plain):
    (plain.path / "camera.json").unlink()
    line, notes = _notes(plain.path)
    assert line == (
        f"{plain.path}: the intrinsics and the depth scale are not known; give them with --intrinsics FX,FY,CX,CY and "
        "--depth-scale UNITS_PER_METRE or in camera.json"
    )
    found = _camera_of(notes)
    assert (found["width"], found["height"], found["cx"], found["cy"]) == (64, 48, 31.5, 23.5)
    assert found["fx"] == found["fy"] == pytest.approx(32 / np.tan(np.radians(30)), abs=0.05)
    assert found["depth_units_per_metre"] == 1000
    guessed = " ".join(note for note in notes if note.startswith("guessed"))
    assert all(name in guessed for name in ("fx, fy", "cx, cy", "depth_units_per_metre"))
    assert not any("width" in note for note in notes if note.startswith("guessed"))
    # the file as it is written opens the recording
    (plain.path / "camera.json").write_text(json.dumps(found))
    assert open_recording(plain.path).intrinsics.fx == found["fx"]


def test_what_is_known_is_not_asked_for(plain):
    (plain.path / "camera.json").unlink()
    line, notes = _notes(plain.path, intrinsics=(60, 61, 31.5, 23.5))
    assert "the depth scale is not known; give it with --depth-scale" in line
    assert _camera_of(notes) == CAMERA | {"depth_units_per_metre": 1000}
    assert not any("fx" in note for note in notes if note.startswith("guessed"))
    line, notes = _notes(plain.path, depth_scale=4000)
    assert "the intrinsics are not known; give them with --intrinsics FX,FY,CX,CY or in" in line
    assert _camera_of(notes)["depth_units_per_metre"] == 4000
    assert not any("units" in note for note in notes if note.startswith("guessed"))
    assert "--depth-scale 4000" in notes[-1]


def test_a_camera_file_without_depth_scale_is_to_be_completed(plain):
    (plain.path / "camera.json").write_text(json.dumps(CAMERA))
    _, notes = _notes(plain.path)
    assert notes[0].startswith('add "depth_units_per_metre": 1000 to ')


def _depth(k, metres, units):
    return FrameEntry(None, lambda: np.full((48, 64), round(metres * units) + k, np.uint16))


@pytest.mark.parametrize(
    ("metres", "units", "guess"),
    [(0.5, 1000, 1000), (1.5, 1000, 1000), (5.0, 1000, 1000), (2.0, 5000, 5000), (3.0, 10000, 10000)],
)
def test_the_depth_scale_is_guessed_from_the_readings(metres, units, guess):
    found = guess_camera([_depth(k, metres, units) for k in range(3)])
    assert found.units == guess
    assert found.median == pytest.approx(metres * units, abs=3)


def test_real_images_tell_their_scale(data_dir):
    for name, units in (("rgbd_dataset_freiburg1_xyz", 5000), ("desk-realsense", 1000), ("dish-from-above", 1000)):
        files = sorted((data_dir / name / "depth").glob("*.png"))
        assert guess_camera([FrameEntry(None, file) for file in files]).units == units


def test_depth_that_is_a_picture_is_named(plain):
    (plain.path / "camera.json").unlink()
    for k in range(5):
        write_image(plain.depth(k), color_image(k))
    _, notes = _notes(plain.path)
    assert any("one channel of 16 bits, it has 3 of 8" in note for note in notes)


def test_depth_of_another_size_needs_its_own_camera(plain):
    (plain.path / "camera.json").unlink()
    for k in range(5):
        write_image(plain.depth(k), depth_image(k, 1000, (24, 32)))
    _, notes = _notes(plain.path)
    assert any("32 x 24 and 64 x 48" in note and "depth_camera" in note for note in notes)


def test_the_command_prints_the_notes(plain, capsys):
    (plain.path / "camera.json").unlink()
    assert main(["info", str(plain.path)]) == 2
    line, *notes = capsys.readouterr().err.splitlines()
    assert line.startswith(f"cuboid: error: {plain.path}: the intrinsics and the depth scale are not known")
    assert notes[0] == f"  write {plain.path}/camera.json, once the guesses are checked:"
    assert max(len(note.replace(str(plain.path), "")) for note in notes) <= 80
    assert notes[-1] == f"    cuboid calibrate {plain.path} --depth-scale 1000 --output {plain.path}/camera.json"
