from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.working import WorkingImage
from cuboid.method.heatmap.pixel_heat import pixel_heat, weigh
from cuboid.method.proposals.types import Proposals


def image(depth: np.ndarray, step: int = 1, phase: tuple[int, int] = (0, 0)) -> WorkingImage:
    h, w = depth.shape
    return WorkingImage(
        depth.astype(np.float32),
        np.zeros((h, w, 3), np.uint8),
        Intrinsics(50.0, 50.0, w / 2, h / 2, w, h),
        step,
        phase,
    )


def boxes(*rows: tuple[int, int, int, int]) -> np.ndarray:
    return np.array(rows, np.int32)


def filled(boxes_xyxy: np.ndarray, scores: list[float]) -> Proposals:
    """Proposals whose masks are their whole boxes."""
    masks = tuple(np.ones((y1 - y0, x1 - x0), np.uint8) for x0, y0, x1, y1 in boxes_xyxy)
    return Proposals(boxes_xyxy, np.array(scores, np.float32), masks)


def heat_of(img: WorkingImage, candidate: np.ndarray, proposals: Proposals) -> np.ndarray:
    readings = candidate.astype(np.uint8)
    return pixel_heat(img, weigh(img, readings, proposals, TrackerConfig()))


def test_one_sure_proposal_heats_its_candidates_and_nothing_else() -> None:
    img = image(np.ones((40, 60)))
    candidate = np.zeros((40, 60), bool)
    candidate[10:20, 10:30] = True
    heat = heat_of(img, candidate, Proposals(boxes((10, 10, 30, 20)), np.array([0.8], np.float32)))
    np.testing.assert_allclose(heat[candidate], 1 - np.exp(-1), rtol=1e-5)
    assert (heat[~candidate] == 0).all()


def test_agreeing_proposals_are_hotter_than_one() -> None:
    img = image(np.ones((40, 60)))
    candidate = np.ones((40, 60), bool)
    heat = heat_of(img, candidate, filled(boxes((5, 5, 25, 25), (15, 5, 35, 25)), [0.5, 0.5]))
    np.testing.assert_allclose(heat[10, 20], 1 - np.exp(-2), rtol=1e-5)
    np.testing.assert_allclose([heat[10, 10], heat[10, 30]], 1 - np.exp(-1), rtol=1e-5)


def test_a_mask_heats_its_own_pixels_in_a_thinned_image() -> None:
    full = np.zeros((40, 60), np.uint8)
    full[8:28, 12:40] = 1
    full[8:12, 12:16] = 0
    x0, y0, x1, y1 = 12, 8, 40, 28
    step, phase = 2, (1, 0)
    img = image(np.ones((20, 30)), step, phase)
    proposals = Proposals(boxes((x0, y0, x1, y1)), np.ones(1, np.float32), (full[y0:y1, x0:x1].copy(),))
    heat = heat_of(img, np.ones((20, 30), bool), proposals)
    np.testing.assert_array_equal(heat > 0, full[0::2, 1::2] > 0)


@pytest.mark.parametrize(("block", "step"), [(2, 2), (2, 4), (4, 2), (3, 2)])
def test_coarse_masks_mean_the_same_as_full_ones(block: int, step: int) -> None:
    rng = np.random.default_rng(2)
    corners = boxes((12, 12, 48, 36), (0, 0, 36, 24))
    coarse = Proposals(
        corners,
        np.array([0.7, 0.4], np.float32),
        tuple(rng.integers(0, 2, ((y1 - y0) // block, (x1 - x0) // block), np.uint8) for x0, y0, x1, y1 in corners),
        block,
    )
    full = Proposals(corners, coarse.scores, coarse.full_masks())
    assert [mask.shape for mask in full.masks or ()] == [(24, 36), (24, 36)]
    img = image(np.ones((48 // step, 60 // step)), step, (1, 0))
    candidate = rng.random(img.depth_m.shape) < 0.9
    heat = heat_of(img, candidate, coarse)
    assert (heat > 0).any()
    np.testing.assert_array_equal(heat, heat_of(img, candidate, full))


@pytest.mark.parametrize(
    ("why", "depth", "box"),
    [
        ("no depth support", np.where(np.arange(60) % 5 == 0, 1.0, 0.0) * np.ones((40, 1)), (10, 10, 30, 30)),
        ("as large as the scene", np.full((40, 60), 5.0), (0, 0, 60, 40)),
        ("smaller than any object", np.full((40, 60), 0.1), (10, 10, 16, 16)),
        (
            "straddles unrelated surfaces",
            np.where(np.arange(60) < 20, 0.5, 2.5) * np.ones((40, 1)),
            (10, 10, 30, 30),
        ),
    ],
)
def test_proposals_that_depth_does_not_bear_out_carry_no_weight(
    why: str, depth: np.ndarray, box: tuple[int, int, int, int]
) -> None:
    heat = heat_of(image(depth), np.ones((40, 60), bool), Proposals(boxes(box), np.ones(1, np.float32)))
    assert (heat == 0).all(), why


def test_a_proposal_that_is_mostly_table_weighs_less() -> None:
    img = image(np.ones((40, 60)))
    candidate = np.zeros((40, 60), bool)
    candidate[10:20, 10:20] = candidate[10:20, 40:50] = True
    proposals = filled(boxes((10, 10, 20, 20), (35, 0, 60, 40)), [1.0, 1.0])
    heat = heat_of(img, candidate, proposals)
    assert heat[15, 45] < 0.3 * heat[15, 15]


def test_a_box_without_a_mask_means_all_candidates_in_it() -> None:
    candidate = np.ones((40, 60), bool)
    candidate[:, 30:35] = False
    inside = np.zeros((40, 60), bool)
    inside[7:29, 15:42] = True
    for step, phase in ((1, (0, 0)), (2, (1, 0)), (3, (1, 2))):
        rows, columns = slice(phase[1], None, step), slice(phase[0], None, step)
        img = image(np.ones((40, 60))[rows, columns], step, phase)
        proposals = Proposals(boxes((15, 7, 42, 29)), np.ones(1, np.float32))
        heat = heat_of(img, candidate[rows, columns], proposals)
        np.testing.assert_array_equal(heat > 0, (inside & candidate)[rows, columns])


def test_no_proposals_no_heat() -> None:
    empty = Proposals(np.zeros((0, 4), np.int32), np.zeros(0, np.float32))
    assert (heat_of(image(np.ones((8, 8))), np.ones((8, 8), bool), empty) == 0).all()
