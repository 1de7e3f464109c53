from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from onnx import TensorProto

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry.rectangles import rect_iou_matrix
from cuboid.inputs.readers import open_recording
from cuboid.method.detection import Detections, make_detector
from cuboid.method.detection.session import Session
from cuboid.method.detection.vocabulary import COCO
from made_models import SIDE, made_model
from made_text_models import made_text_model

CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
THREE = {"names": "{0: 'cup', 1: 'book', 2: 'tv'}"}
# In all models a book of score 0.8 lies here, pixels of the image of 640 x 480.
BOOK = [100, 60, 140, 140]


def look(path: Path, options: str = "") -> Detections:
    color = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    detector = make_detector(f"{path}{options}")
    return detector(Frame(0, 0.0, color, np.ones((480, 640), np.float32)), CAMERA)


def assert_book(found: Detections, score: float = 0.8) -> None:
    assert found.boxes_xyxy[0].tolist() == BOOK
    assert found.names[int(found.scores[0].argmax())] == "book"
    assert float(found.scores[0].max()) == pytest.approx(score, abs=1e-6)


def logit(score: float) -> float:
    return float(np.log(score / (1 - score)))


def stretched(side: int = SIDE) -> tuple[float, float, float, float]:
    """The book in an input that the image is stretched to: centre and size, fractions."""
    x0, y0, x1, y1 = BOOK
    return (x0 + x1) / 2 / 640, (y0 + y1) / 2 / 480, (x1 - x0) / 640, (y1 - y0) / 480


def test_yolov8_with_names_in_its_metadata(tmp_path: Path) -> None:
    table = np.zeros((1, 4 + 3, 2100), np.float32)
    table[0, :, 5] = [60, 90, 20, 40, 0.1, 0.8, 0.0]
    found = look(made_model(tmp_path / "m.onnx", table, metadata=THREE))
    assert_book(found)
    assert found.scores.tolist() == [pytest.approx([0.1, 0.8, 0.0])]
    assert found.names == ("cup", "book", "tv")


def test_yolov8_with_masks(tmp_path: Path) -> None:
    table = np.zeros((1, 4 + 3 + 2, 2100), np.float32)
    table[0, :, 5] = [60, 90, 20, 40, 0.1, 0.8, 0.0, 1.0, 0.0]
    prototypes = np.full((1, 2, SIDE // 4, SIDE // 4), -1.0, np.float32)
    prototypes[0, 0, :, :15] = 1.0  # the input's columns below 60, the image's below 120
    found = look(made_model(tmp_path / "m.onnx", table, prototypes, metadata=THREE))
    assert_book(found)
    assert found.masks is not None
    assert found.masks[0][:, :18].all()
    assert not found.masks[0][:, 22:].any()


def test_yolox_with_names_in_a_file_beside_it(tmp_path: Path) -> None:
    # 40 x 40 cells of 8 pixels; the image lies at the input's upper left, at half size.
    rows = np.zeros((1, 2100, 5 + 3), np.float32)
    rows[0, 5 * 40 + 7] = [0.5, 1.25, np.log(20 / 8), np.log(40 / 8), 0.9, 0.1, 8 / 9, 0.0]
    (tmp_path / "m.txt").write_text("cup\nbook\ntv\n")
    found = look(made_model(tmp_path / "m.onnx", rows))
    assert_book(found)


@pytest.mark.parametrize("strides", [(8, 16, 32), (8, 16, 32, 64)])
def test_nanodet_of_three_and_of_four_grids(tmp_path: Path, strides: tuple[int, ...]) -> None:
    count = sum((-(-SIDE // s)) ** 2 for s in strides)
    rows = np.zeros((1, count, 80 + 32), np.float32)
    rows[0, :, 80:] = -1.0
    # Stretched, the book is 50..70 by 40..93.3 pixels of the input: 6.25..8.75 by 5..11.67 cells of 8.
    cell = 8 * 40 + 7
    at = 0.5 if len(strides) == 3 else 0.0
    x0, y0, x1, y1 = (v / 8 for v in (50, 40, 70, 280 / 3))
    distances = (7 + at - x0, 8 + at - y0, x1 - 7 - at, y1 - 8 - at)
    rows[0, cell, COCO.index("book")] = 0.8
    rows[0, cell, 80:] = np.concatenate([bins(distance) for distance in distances])
    found = look(made_model(tmp_path / "m.onnx", rows))
    assert_book(found)
    assert found.names == COCO


def bins(distance: float) -> NDArray[np.float32]:
    """Logits of a distribution over 0 to 7 whose mean is a distance."""
    low = int(distance)
    weights = np.full(8, 1e-9)
    weights[low], weights[low + 1] = low + 1 - distance, distance - low + 1e-9
    return np.log(weights).astype(np.float32)


def test_picodet_without_its_last_steps(tmp_path: Path) -> None:
    outputs: list[NDArray[np.float32]] = []
    for of in (3, 32):
        outputs += [np.zeros((1, (-(-SIDE // s)) ** 2, of), np.float32) for s in (8, 16, 32, 64)]
    cell = 8 * 40 + 7
    x0, y0, x1, y1 = (v / 8 for v in (50, 40, 70, 280 / 3))
    outputs[0][0, cell] = [0.1, 0.8, 0.0]
    distances = (7.5 - x0, 8.5 - y0, x1 - 7.5, y1 - 8.5)
    outputs[4][0, cell] = np.concatenate([bins(distance) for distance in distances])
    found = look(made_model(tmp_path / "m.onnx", *outputs, metadata=THREE))
    assert_book(found)


def test_picodet_with_its_last_steps(tmp_path: Path) -> None:
    rows = np.array([[1, 0.8, 50, 40, 70, 280 / 3], [-1, 0, 0, 0, 0, 0]], np.float32)
    count = np.array([1], np.int64)
    others: dict[str, Any] = {"scale_factor": (TensorProto.FLOAT, (1, 2)), "im_shape": (TensorProto.FLOAT, (1, 2))}
    path = made_model(tmp_path / "m.onnx", rows, count, others=others, metadata=THREE)
    assert_book(look(path))


def test_rt_detr_and_d_fine_of_their_authors(tmp_path: Path) -> None:
    labels = np.array([[COCO.index("book"), 0]], np.int64)
    boxes = np.array([[[50, 40, 70, 280 / 3], [0, 0, 5, 5]]], np.float32)
    scores = np.array([[0.8, 0.01]], np.float32)
    path = made_model(
        tmp_path / "m.onnx",
        labels,
        boxes,
        scores,
        names=["labels", "boxes", "scores"],
        others={"orig_target_sizes": (TensorProto.INT64, (1, 2))},
    )
    found = look(path)
    assert_book(found)
    assert len(found) == 1


@pytest.mark.parametrize("names", [("pred_boxes", "logits"), ("dets", "labels")])
def test_a_box_and_logits_for_each_query(tmp_path: Path, names: tuple[str, str]) -> None:
    boxes = np.zeros((1, 300, 4), np.float32)
    boxes[0, 7] = stretched()
    logits = np.full((1, 300, 3), -9.0, np.float32)
    logits[0, 7, 1] = logit(0.8)
    assert_book(look(made_model(tmp_path / "m.onnx", boxes, logits, names=names, metadata=THREE)))


def test_rf_detr_numbers_its_classes_as_coco_and_may_have_masks(tmp_path: Path) -> None:
    boxes = np.zeros((1, 300, 4), np.float32)
    boxes[0, 7] = stretched()
    logits = np.full((1, 300, 91), -9.0, np.float32)
    logits[0, 7, 84] = logit(0.8)  # COCO's number of "book"
    logits[0, 8, 12] = 9.0  # a number that COCO does not use
    masks = np.full((1, 300, 80, 80), -1.0, np.float32)
    masks[0, 7, :, :15] = 1.0  # columns of the image below 120
    found = look(made_model(tmp_path / "m.onnx", boxes, logits, masks, names=["dets", "labels", "masks"]))
    assert_book(found)
    assert found.names == COCO
    assert len(found) == 1
    assert found.masks is not None
    assert found.masks[0][:, :16].all()
    assert not found.masks[0][:, 24:].any()


def test_ultralytics_tells_queries_as_rows(tmp_path: Path) -> None:
    rows = np.zeros((1, 300, 4 + 3), np.float32)
    # The image lies in the middle of the input at half size, 40 rows from the top.
    rows[0, 3] = [60 / SIDE, 90 / SIDE, 20 / SIDE, 40 / SIDE, 0.1, 0.8, 0.0]
    assert_book(look(made_model(tmp_path / "m.onnx", rows, metadata=THREE)))


def test_a_last_slot_without_a_name_is_the_background(tmp_path: Path) -> None:
    boxes = np.zeros((1, 300, 4), np.float32)
    boxes[0, 7:9] = stretched()
    logits = np.full((1, 300, 4), -9.0, np.float32)
    logits[0, 7, 1] = logit(0.8)
    logits[0, 8, 3] = 9.0
    path = made_model(tmp_path / "m.onnx", boxes, logits, names=["dets", "labels"], metadata=THREE)
    found = look(path)
    assert_book(found)
    assert len(found) == 1


def test_numbers_that_are_none_are_left_out(tmp_path: Path) -> None:
    table = np.full((1, 4 + 3, 2100), np.nan, np.float32)
    table[0, :, 5] = [60, 90, 20, 40, np.nan, 0.8, np.inf]
    assert_book(look(made_model(tmp_path / "m.onnx", table, metadata=THREE)))
    boxes, logits = np.zeros((1, 300, 4), np.float32), np.full((1, 300, 3), -1e30, np.float32)
    boxes[0, 7], logits[0, 7, 1] = stretched(), 1e30
    assert_book(look(made_model(tmp_path / "q.onnx", boxes, logits, names=["dets", "labels"], metadata=THREE)), 1.0)


def test_options_of_a_model(tmp_path: Path) -> None:
    table = np.zeros((1, 4 + 3, 2100), np.float32)
    table[0, :, 5] = [60, 90, 20, 40, 0.1, 0.8, 0.0]
    table[0, :, 6] = [200, 200, 40, 60, 0.3, 0.0, 0.0]
    path = made_model(tmp_path / "m.onnx", table, metadata=THREE)
    (tmp_path / "own.json").write_text('{"id2label": {"0": "Tasse", "1": "Buch", "2": "Schirm"}}')
    assert len(look(path)) == 2
    assert len(look(path, ":score=0.5,threads=2")) == 1
    assert look(path, f":labels={tmp_path / 'own.json'}").names == ("Tasse", "Buch", "Schirm")


def test_wrong_options_and_names_are_told_in_a_line(tmp_path: Path) -> None:
    path = made_model(tmp_path / "m.onnx", np.zeros((1, 7, 2100), np.float32), metadata=THREE)
    (tmp_path / "two.txt").write_text("cup\nsaucer")
    (tmp_path / "none.txt").write_text("")
    for options, message in (
        (":speed=3", "unknown option 'speed=3' of a detector"),
        (":score=2", r"score must lie in 0\.\.1"),
        (":provider=Abacus", "no provider 'Abacus' here; there are"),
        (f":labels={tmp_path / 'two.txt'}", None),
        (f":labels={tmp_path / 'none.txt'}", "holds no class names"),
        (f":labels={tmp_path / 'gone.txt'}", "cannot be read as a list of class names"),
    ):
        if message is None:  # three classes, two names: the third is the background
            assert look(path, options).names == ("cup", "saucer")
            continue
        with pytest.raises(InputError, match=message):
            look(path, options)
    (tmp_path / "two.txt").write_text("cup")
    with pytest.raises(InputError, match="has 3 classes, but there are 1 names"):
        look(path, f":labels={tmp_path / 'two.txt'}")


def test_unknown_layouts_are_refused_with_what_was_seen(tmp_path: Path) -> None:
    path = made_model(tmp_path / "m.onnx", np.zeros((1, 3, 8, 8), np.float32), names=["depth"])
    with pytest.raises(InputError, match=r"outputs depth \(1, 3, 8, 8\) are of no known kind"):
        make_detector(str(path))
    text = made_model(
        tmp_path / "t.onnx", np.zeros((1, 7, 2100), np.float32), others={"time": (TensorProto.INT64, (1, 16))}
    )
    with pytest.raises(InputError, match=r"its inputs are images \(1, 3, 320, 320\), time \(1, 16\)"):
        make_detector(str(text))
    with pytest.raises(InputError, match=r"unknown detector 'nothing'; there are: d-fine-l, .*yolox-nano"):
        make_detector("nothing")


PROMPTS: dict[str, Any] = {
    "point_coords": (TensorProto.FLOAT, (1, "points", 2)),
    "point_labels": (TensorProto.FLOAT, (1, "points")),
}
TEXTS: dict[str, Any] = dict.fromkeys(("input_ids", "attention_mask"), (TensorProto.INT64, (2, 16)))


@pytest.mark.parametrize(
    ("outputs", "names", "others", "seen"),
    [
        # The encoder of SAM alone, and SAM whose points have other names.
        ([(1, 256, 20, 20)], ["image_embeddings"], {}, r"outputs image_embeddings \(1, 256, 20, 20\) are of"),
        ([(1, 4, 80, 80), (1, 4)], ["masks", "scores"], PROMPTS, r"its inputs are .*point_coords \(1, 'points', 2\)"),
        # Masks without scores, or with scores of another number of masks.
        ([(1, 3, 80, 80)], ["masks"], {}, r"outputs masks \(1, 3, 80, 80\) are of no known kind"),
        ([(1, 3, 80, 80), (1, 5)], ["masks", "scores"], {}, r"masks \(1, 3, 80, 80\), scores \(1, 5\) are of no"),
        # OWL-ViT as features, without a logit for each text.
        (
            [(1, 300, 4), (1, 300, 512)],
            ["pred_boxes", "image_embeds"],
            TEXTS,
            r"inputs input_ids, attention_mask; outputs pred_boxes \(1, 300, 4\), image_embeds \(1, 300, 512\)",
        ),
    ],
)
def test_masks_and_texts_of_other_forms_are_refused(
    tmp_path: Path, outputs: list[tuple[int, ...]], names: list[str], others: dict[str, Any], seen: str
) -> None:
    arrays = [np.zeros(shape, np.float32) for shape in outputs]
    path = made_model(tmp_path / "m.onnx", *arrays, names=names, others=others)
    (tmp_path / "texts.txt").write_text("a mug\na book\n")
    if others is TEXTS:
        pytest.importorskip("tokenizers")
        made_text_model(tmp_path / "texts")  # its tokenizer
        (tmp_path / "tokenizer.json").write_bytes((tmp_path / "texts" / "tokenizer.json").read_bytes())
    with pytest.raises(InputError, match=seen) as refused:
        make_detector(f"{path}:labels={tmp_path / 'texts.txt'}")
    assert "\n" not in str(refused.value)


def test_owl_without_texts_asks_for_them(tmp_path: Path) -> None:
    boxes, logits = np.zeros((1, 300, 4), np.float32), np.zeros((1, 300, 2), np.float32)
    path = made_model(tmp_path / "owl.onnx", boxes, logits, names=["pred_boxes", "logits"], others=TEXTS)
    with pytest.raises(InputError, match="looks for texts: name a file of them, one a line, with labels=FILE"):
        make_detector(str(path))


def test_a_named_model_that_was_not_fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CUBOID_MODELS", str(tmp_path))
    with pytest.raises(InputError, match="'cuboid models fetch yolox-nano' fetches it"):
        make_detector("yolox-nano")


def test_a_real_yolox_knows_the_monitors_on_a_real_desk(data_dir: Path) -> None:
    recording = open_recording(data_dir / "desk-realsense")
    frame = next(f for f in recording.iterate() if f.index == 5)
    assert isinstance(frame, Frame)
    found = make_detector(str(data_dir / "yolox-nano" / "yolox_nano.onnx"))(frame, recording.intrinsics)
    # As a person drew them: data's keyframes.json.
    monitors = np.array([[0, 38, 293, 348], [294, 99, 609, 318]], dtype=np.float64)
    iou = rect_iou_matrix(monitors, found.boxes_xyxy.astype(np.float64))
    assert (iou.max(axis=1) > 0.7).all()
    assert [found.names[k] for k in found.scores[iou.argmax(axis=1)].argmax(axis=1)] == ["tv", "tv"]


def test_fastsam_finds_anything_and_names_nothing(tmp_path: Path) -> None:
    table = np.zeros((1, 4 + 1 + 2, 2100), np.float32)
    table[0, :, 5] = [60, 90, 20, 40, 0.8, 1.0, 0.0]
    prototypes = np.full((1, 2, SIDE // 4, SIDE // 4), -1.0, np.float32)
    prototypes[0, 0, :, :15] = 1.0
    found = look(made_model(tmp_path / "m.onnx", table, prototypes, metadata={"names": "{0: 'object'}"}))
    assert found.boxes_xyxy.tolist() == [BOOK]
    assert found.names == ("",)
    assert found.scores.tolist() == [[pytest.approx(0.8)]]
    assert found.masks is not None
    assert found.masks[0][:, :18].all()


@pytest.mark.parametrize("asked", [False, True])
def test_masks_of_anything_at_a_grid_of_points_or_without(tmp_path: Path, asked: bool) -> None:
    """As SAM's everything, and as EfficientSAM, which takes points and gives three masks for each."""
    logits = np.full((1, 3, 80, 80), -1.0, np.float32)
    # Stretched, the book is 12.5..17.5 by 10..23.3 pixels of masks of a quarter of the input's size.
    logits[0, 1, 10:23, 13:17] = 1.0
    logits[0, 2] = 1.0
    scores = np.array([[0.9, 0.8, 0.01]], np.float32)  # the first is empty, the last not believed
    others: dict[str, Any] = {}
    names = ["masks", "scores"]
    if asked:
        logits = np.stack([np.full_like(logits, 1.0), logits], axis=2)
        scores = np.stack([np.full_like(scores, 0.005), scores], axis=2)
        names = ["output_masks", "iou_predictions"]
        points = {"batched_point_coords": (TensorProto.FLOAT, (1, "q", "p", 2))}
        others = points | {"batched_point_labels": (TensorProto.FLOAT, (1, "q", "p"))}
    found = look(made_model(tmp_path / "m.onnx", logits, scores, names=names, others=others))
    assert len(found) == 1
    assert found.names == ("",)
    assert found.scores.tolist() == [[pytest.approx(0.8)]]
    assert rect_iou_matrix(found.boxes_xyxy.astype(float), np.array([BOOK], float))[0, 0] > 0.7
    assert found.masks is not None
    assert found.masks[0].mean() > 0.9


def test_points_cover_the_input(tmp_path: Path) -> None:
    """The model answers with a mask around its last point, and says whether all are inside."""
    path = tmp_path / "m.onnx"
    masks, scores = np.full((1, 9, 8, 8), -1.0, np.float32), np.full((1, 9), 0.5, np.float32)
    others: dict[str, Any] = {
        "batched_point_coords": (TensorProto.FLOAT, (1, 9, 2, 2)),
        "batched_point_labels": (TensorProto.FLOAT, (1, 9, 2)),
    }
    session = Session(made_model(path, masks, scores, names=["masks", "scores"], others=others), "test")
    place, kind = session._points(240, 320).values()
    assert place.shape == (1, 9, 2, 2)
    assert (kind[0, :, 0] == 1).all()
    assert (kind[0, :, 1] == -1).all()
    x, y = place[0, :, 0].T
    np.testing.assert_allclose(sorted({*x}), (320 / 6, 160, 320 * 5 / 6))
    np.testing.assert_allclose(sorted({*y}), (40, 120, 200))


@pytest.mark.parametrize("two", [False, True])
def test_owl_looks_for_the_texts_in_a_file(tmp_path: Path, two: bool) -> None:
    pytest.importorskip("tokenizers")
    folder = made_text_model(tmp_path / "texts")  # its tokenizer
    (folder / "look.txt").write_text("a mug\nred green blue\n")
    boxes, logits = np.zeros((1, 300, 4), np.float32), np.full((1, 300, 2), -9.0, np.float32)
    if two:  # the image lies at the upper left of a square
        x0, y0, x1, y1 = (value / 640 for value in BOOK)
        boxes[0, 7] = [(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0]
    else:
        boxes[0, 7] = stretched()
    logits[0, 7, 1] = logit(0.8)
    kind: dict[str, Any] = dict.fromkeys(("input_ids", "attention_mask"), (TensorProto.INT64, (2, 16)))
    more = [np.zeros((1, 300), np.float32)] if two else []
    names = ["pred_boxes", "logits", *(["objectness_logits"] if two else [])]
    path = made_model(folder / "owl.onnx", boxes, logits, *more, names=names, others=kind, side="side")
    found = look(path, f":labels={folder / 'look.txt'},size={SIDE}")
    assert found.boxes_xyxy.tolist() == [BOOK]
    assert found.names == ("a mug", "red green blue")
    assert found.scores.tolist() == [pytest.approx([0.0001234, 0.8], abs=1e-6)]
    with pytest.raises(InputError, match="looks for texts: name a file of them, one a line, with labels=FILE"):
        look(path, f":size={SIDE}")
    (folder / "tokenizer.json").unlink()
    with pytest.raises(InputError, match=r"has no tokenizer\.json"):
        look(path, f":labels={folder / 'look.txt'},size={SIDE}")
