"""What a notebook shows, and the objects as a table."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

from cuboid.ground.core.errors import FrameError, MissingExtraError
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import FrameResult, Sighting
from cuboid.inputs.readers import open_recording
from cuboid.results.files.object_table import COLUMNS, ObjectTable
from cuboid.runs.pipeline.options import RunHooks
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from fakes import INTRINSICS, FakeRecording, FakeTracker, box, write_recording


def decoded(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def table(*xs: float) -> ObjectTable:
    tracker = FakeTracker(INTRINSICS)
    recording = FakeRecording(3)
    for k in range(3):
        tracker.update(recording.read(k))
    one = tracker.objects[0]
    return ObjectTable(
        type(one)(k + 1, box(x), *[getattr(one, n) for n in one.__slots__[2:]]) for k, x in enumerate(xs)
    )


def test_a_recording_gives_frames_by_number(tmp_path: Path) -> None:
    recording = open_recording(write_recording(tmp_path / "r", 5))
    assert (recording[3].index, recording[-1].index) == (3, 4)
    assert [frame.index for frame in recording] == [0, 1, 2, 3, 4]
    assert repr(recording) == f"Recording(plain: 5 frames of 64 x 48, with poses; {recording.path})"
    with pytest.raises(IndexError):
        recording[5]
    with pytest.raises(TypeError, match="iterate"):
        recording[1:3]  # type: ignore[index]
    (tmp_path / "r" / "color" / "000002.png").write_bytes(b"")
    with pytest.raises(FrameError):
        recording[2]


def test_a_frame_shows_color_and_depth() -> None:
    frame = FakeRecording(1).read(0)
    picture = decoded(frame._repr_png_())
    assert picture.shape == (48, 128, 3)
    assert (picture[:, :64] == frame.color).all()
    assert repr(frame) == "Frame(0 at 0.000 s: 64 x 48, posed)"


def test_a_result_shows_heat_and_what_is_seen() -> None:
    heat = np.zeros((120, 160), np.float32)
    heat[60:, 80:] = 1.0
    seen = Sighting(3, box(), None, 1.0, np.array([40.0, 60.0, 120.0, 200.0]))
    result = FrameResult(7, 0.5, np.eye(4), (seen,), (), 4, heat, {}, size=(320, 240))
    picture = decoded(result._repr_png_()).astype(int)
    assert picture.shape == (240, 320, 3)
    assert picture[200:, 200:].mean() > picture[:50, 200:].mean() + 50
    assert np.abs(picture[150, 40:42] - color_of(3)).max() < 60
    assert repr(result) == "FrameResult(frame 7: sees #3; 4 objects known)"


def test_objects_are_a_list_and_a_table() -> None:
    objects = table(0.0, 0.5)
    assert isinstance(PosedTracker(INTRINSICS).objects, ObjectTable)
    assert [item.label for item in objects] == [1, 2]
    row = objects.rows()[1]
    assert tuple(row) == COLUMNS
    assert (row["label"], row["x_m"], row["height_m"], row["merged_labels"]) == (2, 0.5, 0.3, [3, 4])
    html = objects._repr_html_()
    tree = ET.fromstring(f"<div>{html}</div>".replace("&#9632;", ""))
    assert len(tree.findall(".//polygon")) == len(tree.findall(".//tbody/tr")) == 2
    assert "10.0 x 20.0 x 30.0" in html
    assert "no object" in ObjectTable()._repr_html_()


def test_pandas_is_asked_for_where_it_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match="'to_pandas' needs pandas, which is not installed: pip install pandas"):
        table(0.0).to_pandas()


def test_pandas_gets_a_row_an_object() -> None:
    pytest.importorskip("pandas", reason="pandas is not installed")
    frame = table(0.0, 0.5, 0.9).to_pandas()
    assert frame.index.tolist() == [1, 2, 3]
    assert frame.loc[3, "x_m"] == 0.9
    assert frame["length_m"].max() == pytest.approx(0.1)


def test_the_outcome_of_a_run_shows_its_objects() -> None:
    outcome = track_recording(FakeRecording(5), None, hooks=RunHooks(make_tracker=FakeTracker))
    html = outcome._repr_html_()
    assert "5 of 5 frames" in html
    assert "<svg" in html
