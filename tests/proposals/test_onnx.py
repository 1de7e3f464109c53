from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from onnx import TensorProto

from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.inputs.readers import open_recording
from cuboid.method.proposals import Proposals, make_source
from made_models import made_model

CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
# Input 320 x 320: an image of 640 x 480 lies in it at half size, 40 rows from the top.
SIDE = 320


def model(path: Path, *outputs: NDArray[np.float32], side: int | str = SIDE, kind: int = TensorProto.FLOAT) -> str:
    return f"onnx:{made_model(path, *outputs, side=side, kind=kind)}"


def propose(spec: str) -> Proposals:
    color = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    return make_source(spec)(Frame(0, 0.0, color, np.ones((480, 640), np.float32)), CAMERA)


def raw(columns: list[list[float]], padding: int = 40) -> NDArray[np.float32]:
    """(1, C, N): the given detections, then such as nobody believes in."""
    table = np.zeros((len(columns[0]), padding), np.float32)
    table[:, : len(columns)] = np.array(columns, dtype=np.float32).T
    return table[None]


def test_raw_boxes_go_back_to_the_image_and_doubles_go(tmp_path: Path) -> None:
    # centre, size in the input, scores of two classes
    output = raw([[60, 90, 20, 40, 0.1, 0.8], [61, 90, 20, 40, 0.7, 0.0], [200, 200, 40, 60, 0.3, 0.2]])
    proposals = propose(model(tmp_path / "m.onnx", output))
    assert proposals.boxes_xyxy.tolist() == [[100, 60, 140, 140], [360, 260, 440, 380]]
    assert proposals.scores.tolist() == pytest.approx([0.8, 0.3])
    assert proposals.masks is None


def test_masks_are_weighted_prototypes_inside_their_boxes(tmp_path: Path) -> None:
    prototypes = np.zeros((1, 2, SIDE // 4, SIDE // 4), np.float32)
    prototypes[0, 0] = -1.0
    prototypes[0, 0, :, :15] = 1.0  # the input's columns below 60, the image's below 120
    prototypes[0, 1] = 1.0
    output = raw([[60, 90, 20, 40, 0.9, 1.0, 0.0], [200, 200, 40, 60, 0.3, 0.0, 1.0]])
    proposals = propose(model(tmp_path / "m.onnx", output, prototypes))
    assert proposals.boxes_xyxy.tolist() == [[100, 60, 140, 140], [360, 260, 440, 380]]
    assert proposals.masks is not None
    left, whole = proposals.masks
    assert left.shape == (80, 40)
    assert left[:, :18].all()
    assert not left[:, 22:].any()
    assert whole.all()


def test_final_detections_are_taken_as_they_are(tmp_path: Path) -> None:
    rows = np.array([[50, 70, 70, 110, 0.8, 3], [180, 170, 220, 230, 0.3, 0], [0, 0, 0, 0, 0, 0]], np.float32)
    expected = [[100, 60, 140, 140], [360, 260, 440, 380]]
    assert propose(model(tmp_path / "three.onnx", rows[None])).boxes_xyxy.tolist() == expected
    assert propose(model(tmp_path / "two.onnx", rows)).boxes_xyxy.tolist() == expected


def test_rows_with_an_object_score(tmp_path: Path) -> None:
    rows = np.zeros((1, 50, 8), np.float32)
    rows[0, 0] = [60, 90, 20, 40, 0.5, 0.2, 0.8, 0.1]
    proposals = propose(model(tmp_path / "m.onnx", rows))
    assert proposals.boxes_xyxy.tolist() == [[100, 60, 140, 140]]
    assert proposals.scores.tolist() == pytest.approx([0.4])


def test_boxes_within_the_cells_of_yolox(tmp_path: Path) -> None:
    # 40 x 40 cells of 8 pixels, 20 x 20 of 16, 10 x 10 of 32; the image lies at the input's upper left, at half size.
    rows = np.zeros((1, 1600 + 400 + 100, 7), np.float32)
    rows[0, 1600 + 8 * 20 + 5] = [0.25, 0.5, np.log(2.0), np.log(1.5), 0.5, 0.8, 0.1]
    proposals = propose(model(tmp_path / "m.onnx", rows))
    # Centre (84, 136), 32 x 24 pixels of the input.
    assert proposals.boxes_xyxy.tolist() == [[136, 248, 200, 296]]
    assert proposals.scores.tolist() == pytest.approx([0.4])


def test_a_row_a_cell_of_a_model_that_tells_pixels(tmp_path: Path) -> None:
    rows = np.zeros((1, 2100, 7), np.float32)
    rows[0, 0] = [60, 90, 20, 40, 0.5, 0.8, 0.1]
    assert propose(model(tmp_path / "m.onnx", rows)).boxes_xyxy.tolist() == [[100, 60, 140, 140]]


def test_a_real_yolox_finds_the_monitors_on_a_real_desk(data_dir: Path) -> None:
    recording = open_recording(data_dir / "desk-realsense")
    frame = next(f for f in recording.iterate() if f.index == 5)
    assert isinstance(frame, Frame)
    found = make_source(f"onnx:{data_dir / 'yolox-nano' / 'yolox_nano.onnx'}")(frame, recording.intrinsics)
    # As a person drew them: data's keyframes.json.
    monitors = np.array([[0, 38, 293, 348], [294, 99, 609, 318]], dtype=np.float64)
    assert (rect_iou_matrix(monitors, found.boxes_xyxy.astype(np.float64)).max(axis=1) > 0.7).all()
    assert len(found) < 30


def test_an_input_of_any_size_and_of_half_precision(tmp_path: Path) -> None:
    # 640 x 480 are multiples of the stride: the image lies in the input as it is
    output = raw([[60, 90, 20, 40, 0.1, 0.8]])
    proposals = propose(model(tmp_path / "m.onnx", output, side="n", kind=TensorProto.FLOAT16))
    assert proposals.boxes_xyxy.tolist() == [[50, 70, 70, 110]]


def test_nothing_found_is_no_error(tmp_path: Path) -> None:
    assert len(propose(model(tmp_path / "m.onnx", raw([[0, 0, 0, 0, 0, 0]])))) == 0
    assert len(propose(model(tmp_path / "e.onnx", np.zeros((1, 0, 6), np.float32)))) == 0


def test_what_is_no_model_of_a_known_kind_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"onnx:MODEL\.onnx"):
        make_source("onnx")
    with pytest.raises(InputError, match="no model at"):
        make_source(f"onnx:{tmp_path / 'nothing.onnx'}")
    (tmp_path / "text.onnx").write_text("not a model")
    with pytest.raises(InputError, match="is no ONNX model that can be run"):
        make_source(f"onnx:{tmp_path / 'text.onnx'}")
    with pytest.raises(InputError, match=r"outputs output0 \(1, 1000\) are of no known kind"):
        propose(model(tmp_path / "classes.onnx", np.zeros((1, 1000), np.float32)))


def test_without_onnx_runtime_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[onnx\]'"):
        make_source(f"onnx:{tmp_path / 'm.onnx'}")
