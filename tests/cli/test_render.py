"""`cuboid render` on what a run left behind."""

from __future__ import annotations

import shutil
from pathlib import Path

import av
import numpy as np
import pytest

from called import run_command
from cuboid.cli import render
from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.inputs.readers import open_recording
from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions
from cuboid.runs.pipeline.run import track_recording
from fakes import FakeTracker, write_recording

FRAMES = 7


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Results of a run over every second frame, one of which is broken."""
    recording = write_recording(tmp_path / "recording", FRAMES, (120, 160))
    (recording / "depth" / "000002.png").write_bytes(b"")
    output = tmp_path / "results"
    track_recording(
        open_recording(recording),
        output,
        TrackOptions(every=2),
        results=ResultOptions(video=True),
        hooks=RunHooks(make_tracker=FakeTracker),
    )
    return output


def decode(path: Path) -> list[UInt8Array]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


@pytest.mark.parametrize(
    ("flags", "name"),
    [
        ((), "labelled.mp4"),
        (("--show", "heat"), "heat.mp4"),
        (("--show", "depth"), "depth.mp4"),
        (("--show", "proposals"), "proposals.mp4"),
        (("--gif",), "labelled.gif"),
        (("--show", "depth", "--gif"), "depth.gif"),
    ],
)
def test_each_view_has_every_used_frame(
    results: Path, flags: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(render, results, *flags, "--force") == 0
    shown = decode(results / name)
    assert len(shown) == 3  # 0, 4 and 6
    assert shown[0].shape == (120, 160, 3)
    assert capsys.readouterr().out == f"3 frames drawn; video in {results / name}\n"


def test_the_views_differ(results: Path) -> None:
    last = []
    for flags in ((), ("--show", "depth"), ("--show", "proposals"), ("--show", "planes")):
        run_command(render, results, *flags, "--force", "-o", results / "view.mp4")
        last.append(decode(results / "view.mp4")[-1].astype(int))
    assert all(np.abs(a - b).mean() > 0.5 for a, b in [(last[0], one) for one in last[1:]])


def test_what_is_drawn_anew_is_what_was_drawn_in_the_run(results: Path) -> None:
    before = decode(results / "labelled.mp4")
    run_command(render, results, "--force")
    strip_px = 24  # says frames a second, which the run measured anew in every frame
    for a, b in zip(before, decode(results / "labelled.mp4"), strict=True):
        assert np.abs(a[:-strip_px].astype(int) - b[:-strip_px]).mean() < 0.5


def test_the_recording_may_have_moved(results: Path, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere"
    shutil.move(tmp_path / "recording", moved)
    with pytest.raises(InputError, match="recording"):
        run_command(render, results, "--force")
    assert run_command(render, results, "--recording", moved, "--force") == 0


def test_another_recording_is_refused(results: Path, tmp_path: Path) -> None:
    large = write_recording(tmp_path / "large", FRAMES, (240, 320))
    short = write_recording(tmp_path / "short", 3, (120, 160))
    for other, got in ((large, "7 frames of 320 x 240"), (short, "3 frames of 160 x 120")):
        with pytest.raises(InputError, match=f"expected frame 6 and 160 x 120 pixels, got {got}"):
            run_command(render, results, "--recording", other, "--force")


def test_wrong_calls_are_one_line(results: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.gif: the video's name must end with \.mp4, or give --gif"):
        run_command(render, results, "--output", tmp_path / "a.gif")
    with pytest.raises(InputError, match="expected a folder with the results"):
        run_command(render, tmp_path / "nothing")
    (results / "tracks.csv").unlink()
    with pytest.raises(InputError, match=r"tracks\.csv: cannot be read"):
        run_command(render, results, "--force")


def test_times_that_fit_no_frame_are_an_error_and_leave_no_video(results: Path) -> None:
    lines = (results / "trajectory.txt").read_text().splitlines()
    (results / "trajectory.txt").write_text("".join(f"9{line}\n" for line in lines))
    with pytest.raises(InputError, match=r"no frame of .* is in its trajectory"):
        run_command(render, results, "--show", "depth")
    assert not (results / "depth.mp4").exists()
