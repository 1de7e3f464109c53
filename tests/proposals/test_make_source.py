from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest
import solids

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.boxes import best_boxes, thin_out
from cuboid.method.proposals import DEFAULT_SOURCE, SOURCES, Proposals, make_source
from cuboid.method.proposals.bing import silent_stdout
from cuboid.method.proposals.boxes import masks_as_proposals


def scene() -> Frame:
    r = solids.rays()
    things = [
        solids.box(r, solids.on_table(-0.15, 0.85, 0.075), (0.1, 0.06, 0.15), 0.5),
        solids.sphere(r, solids.on_table(0.2, 0.8, 0.05), 0.05),
    ]
    return solids.frame(things, 1.425e-3)[0]


def best_overlaps(proposals: Proposals, owner: solids.Hit) -> list[float]:
    """Return for each thing the IoU of its rectangle with the nearest proposal."""
    found = []
    for k in (1, 2):
        rows, columns = np.nonzero(owner == k)
        true = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        low = np.maximum(proposals.boxes_xyxy[:, :2], true[:2])
        high = np.minimum(proposals.boxes_xyxy[:, 2:], true[2:])
        both = np.prod(np.maximum(high - low, 0), axis=1)
        area = np.prod(proposals.boxes_xyxy[:, 2:] - proposals.boxes_xyxy[:, :2], axis=1)
        found.append(float((both / (area + np.prod(true[2:] - true[:2]) - both)).max()))
    return found


@pytest.mark.parametrize("name", ["depth", "edgeboxes", "selective-search"])
def test_a_source_without_options_finds_two_things_on_a_table(name: str) -> None:
    frame = scene()
    proposals = make_source(name)(frame, solids.CAMERA)
    r = solids.rays()
    _, owner = solids.frame(
        [
            solids.box(r, solids.on_table(-0.15, 0.85, 0.075), (0.1, 0.06, 0.15), 0.5),
            solids.sphere(r, solids.on_table(0.2, 0.8, 0.05), 0.05),
        ]
    )
    assert min(best_overlaps(proposals, owner)) > 0.5
    assert ((proposals.scores >= 0) & (proposals.scores <= 1)).all()
    assert (np.diff(proposals.scores) <= 0).all()
    with pytest.raises(InputError, match=f"'{name}(:N)?' takes .*"):
        make_source(f"{name}:x")


@pytest.mark.parametrize("name", ["depth", "edgeboxes", "selective-search"])
@pytest.mark.parametrize("depth", [0.0, 1.0])
def test_a_frame_without_anything_is_no_error(name: str, depth: float) -> None:
    frame = Frame(0, 0.0, np.full((120, 160, 3), 90, np.uint8), np.full((120, 160), depth, np.float32))
    proposals = make_source(name)(frame, Intrinsics(140.0, 140.0, 79.5, 59.5, 160, 120))
    assert proposals.boxes_xyxy.shape == (len(proposals), 4)


@pytest.mark.parametrize("name", ["edgeboxes", "selective-search"])
def test_chance_has_no_part(name: str) -> None:
    frame = scene()
    source = make_source(name)
    one, two = source(frame, solids.CAMERA), source(frame, solids.CAMERA)
    assert one.boxes_xyxy.tobytes() == two.boxes_xyxy.tobytes()
    assert one.scores.tobytes() == two.scores.tobytes()


def test_bing_proposes_boxes_and_prints_and_leaves_nothing(
    data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    model = data_dir / "bing-model"
    before = sorted(model.iterdir())
    proposals = make_source(f"bing:{model}")(scene(), solids.CAMERA)
    print("after", flush=True)
    assert capfd.readouterr().out == "after\n"
    assert len(proposals) > 10
    assert (proposals.boxes_xyxy >= 0).all()
    assert (proposals.boxes_xyxy[:, 2:] <= (640, 480)).all()
    assert sorted(model.iterdir()) == before
    assert not list(tmp_path.iterdir())


def test_bing_without_its_model_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="needs the folder"):
        make_source("bing")
    with pytest.raises(InputError, match=r"ObjNessB2W8MAXBGR\.idx\.yml\.gz is missing"):
        make_source(f"bing:{tmp_path}")


def test_what_native_code_prints_is_silenced_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with silent_stdout():
        os.write(1, b"noise")
    print("after", flush=True)
    assert capfd.readouterr().out == "before\nafter\n"


def test_the_default_is_a_source_and_any_callable_is_one() -> None:
    assert DEFAULT_SOURCE in SOURCES.names()
    assert type(make_source(None)) is type(make_source(DEFAULT_SOURCE))

    def own(frame: Frame, intrinsics: Intrinsics) -> Proposals:
        return Proposals(np.array([[0, 0, 4, 4]], np.int32), np.ones(1, np.float32))

    assert make_source(own) is own


def test_an_unknown_source_lists_those_there_are() -> None:
    with pytest.raises(InputError, match=r"unknown proposal source 'magic'; there are: .*bing.*depth.*onnx"):
        make_source("magic:1")


def test_boxes_are_clipped_sorted_and_limited() -> None:
    boxes = [[-5, -5, 10, 10], [0.4, 0.6, 4.5, 4.4], [50, 0, 60, 10], [3, 3, 3, 9], [0, 0, np.nan, 4], [1, 1, 40, 40]]
    found, scores, rows = best_boxes(boxes, [0.2, 0.9, 1.0, 1.0, 1.0, 7.0], 32, 24)
    assert rows.tolist() == [5, 1, 0]
    assert found.tolist() == [[1, 1, 32, 24], [0, 1, 4, 4], [0, 0, 10, 10]]
    assert scores.tolist() == pytest.approx([1.0, 0.9, 0.2])
    assert best_boxes(boxes, [0.2, 0.9, 1.0, 1.0, 1.0, 7.0], 32, 24, max_boxes=1)[2].tolist() == [5]


def test_thinning_keeps_the_best_of_those_that_overlap() -> None:
    boxes = np.array([[0, 0, 10, 10], [0, 0, 10, 9], [20, 0, 30, 10], [0, 0, 10, 4]], dtype=np.float64)
    assert thin_out(boxes, np.array([0.5, 0.9, 0.1, 0.2]), 0.5).tolist() == [1, 3, 2]


def test_masks_are_cropped_and_empty_ones_left_out() -> None:
    masks = np.zeros((3, 8, 9), np.uint8)
    masks[0, 2:4, 3:7] = 255
    masks[2, 7, 8] = 1
    proposals = masks_as_proposals(masks, [0.3, 0.9, 0.5])
    assert proposals.boxes_xyxy.tolist() == [[8, 7, 9, 8], [3, 2, 7, 4]]
    assert proposals.masks is not None
    assert [m.tolist() for m in proposals.masks] == [[[1]], [[1, 1, 1, 1], [1, 1, 1, 1]]]


def test_edgeboxes_takes_no_longer_for_noise() -> None:
    """The strongest edges, all over the image, are those of as many as a real desk has."""
    rng = np.random.default_rng(0)
    cells = rng.uniform(0.8, 1.6, (11, 14))
    depth = cells[np.ix_(np.arange(480) // 48, np.arange(640) // 48)].astype(np.float32)
    frame = Frame(0, 0.0, rng.integers(0, 256, (480, 640, 3), dtype=np.uint8), depth)
    source, camera = make_source("edgeboxes"), Intrinsics(540.0, 540.0, 319.5, 239.5, 640, 480)
    source(frame, camera)
    begun_s = time.thread_time()
    proposals = source(frame, camera)
    assert time.thread_time() - begun_s < 0.5
    middle = proposals.boxes_xyxy.reshape(-1, 2, 2).mean(1)
    assert (np.ptp(middle, axis=0) > (300, 200)).all(), "boxes lie all over the image"
