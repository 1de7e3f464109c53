from __future__ import annotations

import shutil
from pathlib import Path

import av
import numpy as np
import pytest

from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, Sighting, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.results.views.drawing import hidden_objects
from cuboid.results.views.video import VideoView, video_rate

INTRINSICS = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
BOX = Box(np.array([0.0, 0.0, 1.0]), np.full(3, 0.3), np.eye(3))


def tracked(label: int) -> TrackedObject:
    return TrackedObject(label, BOX, 0.9, 0.8, 0, 9, 9, 100, np.zeros(3), None)


def result(index: int, seen: tuple[int, ...], milliseconds: float = 20.0) -> FrameResult:
    sightings = tuple(Sighting(label, BOX, 0.7, 1.0, np.zeros(4)) for label in seen)
    heat = np.zeros((120, 160), np.float32)  # a tracker at half size
    return FrameResult(index, index / 30, np.eye(4), sightings, (), 1, heat, {"all": milliseconds})


def frame(index: int) -> Frame:
    return Frame(index, index / 30, np.full((240, 320, 3), 100, np.uint8), np.ones((240, 320), np.float32), np.eye(4))


def show(path: Path, seen: list[tuple[int, ...]], complete: bool = True, milliseconds: float = 20.0) -> None:
    view = VideoView(path, INTRINSICS, 30.0)
    for index, labels in enumerate(seen):
        view.show(frame(index), result(index, labels, milliseconds), [tracked(1)])
    view.close(complete=complete)


@pytest.mark.parametrize("complete", [True, False])
def test_every_frame_shown_is_in_a_video_that_opens(tmp_path: Path, complete: bool) -> None:
    show(tmp_path / "a.mp4", [(), (1,), (1,), ()], complete)
    with av.open(str(tmp_path / "a.mp4")) as container:
        shown = [one.to_ndarray(format="rgb24").astype(int) for one in container.decode(video=0)]
    assert len(shown) == 4
    edge = [picture[119, 159 - 53] for picture in shown]  # on the left edge of the front: 300 * 0.15 / 0.85
    assert edge[1][2] - edge[1][0] > 60  # label 1 is blue
    assert abs(shown[1][119, 10] - 100).max() < 12


def test_a_known_object_that_is_not_seen_is_hidden() -> None:
    assert [item.label for item in hidden_objects(result(0, (2,)).sightings, [tracked(1), tracked(2)])] == [1]


def test_the_same_run_gives_the_same_bytes_however_long_it_took(tmp_path: Path) -> None:
    for name, milliseconds in (("a.mp4", 20.0), ("b.mp4", 125.0)):
        show(tmp_path / name, [(1,), (), (1,)], milliseconds=milliseconds)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_video_that_cannot_be_written_says_so_unless_the_run_was_broken_off(tmp_path: Path) -> None:
    for complete in (True, False):
        view = VideoView(tmp_path / "gone" / "a.mp4", INTRINSICS, 30.0)
        (tmp_path / "gone").mkdir()
        view.show(frame(0), result(0, (1,)), [])
        shutil.rmtree(tmp_path / "gone")
        if complete:
            with pytest.raises(OutputError, match=r"a\.mp4: cannot be written"):
                view.close(complete=True)
        else:
            view.close(complete=False)


def test_the_video_keeps_the_pace_of_the_scene() -> None:
    assert [video_rate(every) for every in (1, 2, 6, 30)] == [30.0, 15.0, 5.0, 5.0]
