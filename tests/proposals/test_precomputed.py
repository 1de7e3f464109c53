from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals import Proposals, make_source

CAMERA = Intrinsics(50.0, 50.0, 15.5, 11.5, 32, 24)


def frame(index: int) -> Frame:
    return Frame(index, 0.0, np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32))


def propose(folder: Path, index: int = 7) -> Proposals:
    return make_source(f"precomputed:{folder}")(frame(index), CAMERA)


def test_csv_boxes_in_any_order_of_columns(tmp_path: Path) -> None:
    (tmp_path / "00007.csv").write_text("score,x0,y0,x1,y1,note\n0.25,1,2,5,6,a\n0.5,-3,0,99,12,b\n")
    proposals = propose(tmp_path)
    assert proposals.boxes_xyxy.tolist() == [[0, 0, 32, 12], [1, 2, 5, 6]]
    assert proposals.scores.tolist() == [0.5, 0.25]
    assert proposals.masks is None


def test_a_csv_with_a_header_alone_is_a_frame_without_proposals(tmp_path: Path) -> None:
    (tmp_path / "00007.csv").write_text("x0,y0,x1,y1,score\n")
    assert len(propose(tmp_path)) == 0


def test_npz_boxes_and_masks(tmp_path: Path) -> None:
    np.savez(tmp_path / "frame-000007.npz", boxes=[[1, 2, 5, 6]], scores=[0.4])
    masks = np.zeros((1, 24, 32), dtype=np.bool_)
    masks[0, 3:5, 4:9] = True
    np.savez(tmp_path / "frame-000008.npz", masks=masks, scores=[0.6])
    assert propose(tmp_path).boxes_xyxy.tolist() == [[1, 2, 5, 6]]
    with_masks = propose(tmp_path, 8)
    assert with_masks.boxes_xyxy.tolist() == [[4, 3, 9, 5]]
    assert with_masks.masks is not None
    assert with_masks.masks[0].all()


def test_mcg_boxes_count_from_one_and_include_their_ends(tmp_path: Path) -> None:
    # up, left, down, right of the pixels in rows 2..5, columns 3..9, counted from 0
    boxes = np.array([[3, 4, 6, 10]], dtype=np.float64)
    savemat(tmp_path / "00007-color.mat", {"bboxes": boxes, "bboxes_scores": np.array([[0.7]])})
    assert propose(tmp_path).boxes_xyxy.tolist() == [[3, 2, 10, 6]]
    savemat(tmp_path / "00008-color.mat", {"candidates_mcg": {"bboxes": boxes, "scores": np.array([[0.7]])}})
    assert propose(tmp_path, 8).boxes_xyxy.tolist() == [[3, 2, 10, 6]]


def test_mcg_masks_are_unions_of_superpixels(tmp_path: Path) -> None:
    superpixels = np.ones((24, 32), np.uint16)
    superpixels[4:8, 10:14] = 2
    superpixels[4:8, 14:20] = 3
    labels = np.empty((2, 1), dtype=object)
    labels[0, 0], labels[1, 0] = np.array([[2, 3]]), np.array([[3]])
    fields = {"superpixels": superpixels, "labels": labels, "scores": np.array([[0.2], [0.9]])}
    savemat(tmp_path / "7.mat", {"candidates": fields})
    proposals = propose(tmp_path)
    assert proposals.boxes_xyxy.tolist() == [[14, 4, 20, 8], [10, 4, 20, 8]]
    assert proposals.masks is not None
    assert all(mask.all() for mask in proposals.masks)


def test_cpmc_masks(tmp_path: Path) -> None:
    masks = np.zeros((24, 32, 2), dtype=np.bool_)
    masks[0:4, 0:6, 0] = True
    masks[10:14, 20:24, 1] = True
    savemat(tmp_path / "7.mat", {"masks": masks, "scores": np.array([[0.9], [0.1]])})
    assert propose(tmp_path).boxes_xyxy.tolist() == [[0, 0, 6, 4], [20, 10, 24, 14]]
    savemat(tmp_path / "8.mat", {"masks": masks[..., 0], "scores": 0.9})  # MATLAB drops a last dimension of one
    assert propose(tmp_path, 8).boxes_xyxy.tolist() == [[0, 0, 6, 4]]


def test_scores_of_any_range_keep_their_order_in_0_1(tmp_path: Path) -> None:
    np.savez(tmp_path / "7.npz", boxes=[[0, 0, 4, 4], [4, 0, 8, 4], [8, 0, 12, 4]], scores=[-3.0, 5.0, 1.0])
    proposals = propose(tmp_path)
    assert proposals.boxes_xyxy[:, 0].tolist() == [4, 8, 0]
    assert proposals.scores.tolist() == [1.0, 0.5, 0.0]


def test_a_frame_without_its_file_is_skipped_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "00007.csv").write_text("x0,y0,x1,y1,score\n")
    with pytest.raises(FrameError, match="frame 9 has no file of proposals in"):
        propose(tmp_path, 9)


def test_a_folder_that_cannot_be_used_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="precomputed:FOLDER"):
        make_source("precomputed")
    with pytest.raises(InputError, match="no folder of proposals"):
        make_source(f"precomputed:{tmp_path / 'nowhere'}")
    with pytest.raises(InputError, match=r"has no files of proposals; expected are NUMBER\.csv"):
        make_source(f"precomputed:{tmp_path}")
    for name in ("a-7.csv", "b-07.csv"):
        (tmp_path / name).write_text("x0,y0,x1,y1,score\n")
    with pytest.raises(InputError, match=r"a-7\.csv and b-07\.csv are both of frame 7"):
        make_source(f"precomputed:{tmp_path}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x0,y0,x1,y1\n1,2,3,4\n", ":1: expected a header with x0,y0,x1,y1,score; missing: score"),
        ("", ":1: expected a header with x0,y0,x1,y1,score; missing: x0"),
        ("x0,y0,x1,y1,score\n1,2,3,4,0.5\n1,2,3\n", ":3: expected 5 values, got 3"),
        ("x0,y0,x1,y1,score\n1,2,3,four,0.5\n", ":2: y1: expected a number, got 'four'"),
        ("x0,y0,x1,y1,score\n400,2,500,40,0.5\n", "box 0 lies outside the image of 32 x 24"),
    ],
)
def test_a_wrong_csv_is_told_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "7.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        propose(tmp_path)


def test_a_wrong_npz_is_told(tmp_path: Path) -> None:
    (tmp_path / "1.npz").write_bytes(b"PK nothing")
    np.savez(tmp_path / "2.npz", scores=[0.1])
    np.savez(tmp_path / "3.npz", boxes=[[0, 0, 1, 1]], scores=[0.1, 0.2])
    np.savez(tmp_path / "4.npz", masks=np.zeros((1, 12, 16)), scores=[0.1])
    np.savez(tmp_path / "5.npz", boxes=[[0, 0, 1]], scores=[0.1])
    np.savez(tmp_path / "6.npz", boxes=np.array([[None]]), scores=[0.1])
    messages = (
        "cannot be read",
        "holds scores; expected",
        "1 scores expected, got 2",
        "masks of 16 x 12 pixels, expected 32 x 24",
        r"boxes must be \(N, 4\)",
        "cannot be read",
    )
    for index, message in enumerate(messages, start=1):
        with pytest.raises(InputError, match=message):
            propose(tmp_path, index)


def test_a_wrong_mat_is_told(tmp_path: Path) -> None:
    (tmp_path / "1.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    (tmp_path / "2.mat").write_bytes(b"nothing of that sort" * 30)
    savemat(tmp_path / "3.mat", {"segments": np.zeros((2, 2))})
    (tmp_path / "4.mat").write_bytes(b"")
    for index, message in enumerate(
        ("MATLAB 7.3.*'-v7'", "cannot be read", "holds segments; expected", "cannot be read"), 1
    ):
        with pytest.raises(InputError, match=message):
            propose(tmp_path, index)
