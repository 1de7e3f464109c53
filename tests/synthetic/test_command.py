from __future__ import annotations

import argparse
import sys

import pytest

import cuboid
from cuboid.cli import synth
from cuboid.ground.core.errors import MissingExtraError
from cuboid.lab.synthetic import KINDS
from cuboid.lab.synthetic.looks import STYLES
from cuboid.lab.synthetic.paths import CAMERAS, POSE_NOISES
from cuboid.lab.synthetic.sensors import SENSORS


def call(*words: str) -> int:
    parser = argparse.ArgumentParser()
    synth.add_arguments(parser)
    return synth.run(parser.parse_args(words))


def test_the_command_knows_all_there_is():
    assert tuple(KINDS) == synth.KINDS
    assert tuple(CAMERAS) == synth.CAMERAS
    assert tuple(SENSORS) == synth.SENSORS
    assert tuple(POSE_NOISES) == synth.POSE_NOISES
    assert STYLES == synth.STYLES


def test_a_recording_is_made_and_named(tmp_path, capsys):
    out = tmp_path / "made"
    words = "--kind clutter --seed 2 --frames 4 --size 64x48 --sensor time-of-flight --motion drone"
    words += " --pose-noise drift --faults zero-depth,nan-pose --workers 1 --style real"
    assert call("--output", str(out), *words.split()) == 0
    assert capsys.readouterr().out.startswith("synthetic clutter 2: 4 frames, ")
    recording = cuboid.open_recording(out)
    assert len(recording) == 4
    assert sum(isinstance(item, cuboid.Frame) for item in recording.iterate()) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--seed", "-1"], "a whole number of at least 0"),
        (["--size", "640"], "expected WIDTHxHEIGHT such as 640x480"),
        (["--kind", "garage"], "invalid choice: 'garage'"),
        (["--frames", "0"], "at least 1"),
    ],
)
def test_a_wrong_call_is_told(words, message, tmp_path, capsys):
    with pytest.raises(SystemExit):
        call("--output", str(tmp_path / "made"), *words)
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("missing", "words", "feature"),
    [("embreex", (), "cuboid synth"), ("trimesh", ("--meshes", "."), "cuboid synth --meshes")],
)
def test_without_the_extra_one_line_names_it(tmp_path, monkeypatch, missing, words, feature):
    for name in [missing, *(name for name in sys.modules if name.startswith(f"{missing}."))]:
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "a.ply").write_text("ply")
    monkeypatch.chdir(tmp_path)
    expected = rf"'{feature}' needs {missing}, which is not installed: .* pip install '\.\[synth\]'"
    with pytest.raises(MissingExtraError, match=expected):
        call("--output", str(tmp_path / "made"), "--frames", "2", "--workers", "1", *words)
    assert not (tmp_path / "made").exists()
