from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import solids
from numpy.typing import NDArray

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.downscaling import downscale
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals import Proposals, make_source

NOISE = 1.425e-3


def whole_mask(proposals: Proposals, k: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    masks = proposals.full_masks()
    assert masks is not None
    mask = np.zeros(shape, dtype=np.bool_)
    x0, y0, x1, y1 = proposals.boxes_xyxy[k]
    mask[y0:y1, x0:x1] = masks[k] > 0
    return mask


def overlaps(proposals: Proposals, wanted: NDArray[np.bool_]) -> NDArray[np.float64]:
    masks = [whole_mask(proposals, k, wanted.shape) for k in range(len(proposals))]
    return np.array([(m & wanted).sum() / (m | wanted).sum() for m in masks])


def ball_box_cup() -> list[solids.Hit]:
    r = solids.rays()
    return [
        solids.sphere(r, solids.on_table(-0.25, 0.9, 0.04), 0.04),
        solids.box(r, solids.on_table(0.0, 0.85, 0.075), (0.1, 0.06, 0.15), 0.5),
        solids.cup(r, solids.on_table(0.25, 0.8, 0.0), 0.045, 0.1),
    ]


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_each_thing_on_a_table_is_one_proposal_among_the_first(noise: float) -> None:
    frame, owner = solids.frame(ball_box_cup(), noise)
    proposals = make_source("depth")(frame, solids.CAMERA)
    for k, name in enumerate(("ball", "box", "cup"), start=1):
        fits = overlaps(proposals, owner == k)
        assert fits.max() > 0.8, name
        assert np.argmax(fits) < 12, f"{name} is only number {np.argmax(fits)} of {len(fits)}"


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_things_that_touch_are_proposed_apart(noise: float) -> None:
    r = solids.rays()
    things = [
        solids.sphere(r, solids.on_table(0.0, 0.8, 0.05), 0.05),
        solids.box(r, solids.on_table(0.1, 0.8, 0.075), (0.1, 0.1, 0.15), 0.0),
    ]
    frame, owner = solids.frame(things, noise)
    proposals = make_source("depth")(frame, solids.CAMERA)
    assert overlaps(proposals, owner == 1).max() > 0.75
    assert overlaps(proposals, owner == 2).max() > 0.75


def test_what_meets_in_a_crease_is_more_likely_two_things_where_it_has_two_colors() -> None:
    r = solids.rays()
    low = solids.box(r, solids.on_table(0.0, 0.75, 0.03), (0.08, 0.08, 0.06), 0.0)
    high = solids.box(r, solids.on_table(0.0, 0.83, 0.06), (0.08, 0.08, 0.12), 0.0)
    frame, owner = solids.frame([low, high], NOISE)
    yellow, blue = (200, 180, 40), (40, 60, 190)
    scores = []
    for paint in ((yellow, yellow), (yellow, blue)):
        color = np.full((*owner.shape, 3), 120, np.uint8)
        color[owner == 1], color[owner == 2] = paint
        proposals = make_source("depth")(dataclasses.replace(frame, color=color), solids.CAMERA)
        fits = [overlaps(proposals, wanted) for wanted in (owner > 0, owner == 1, owner == 2)]
        assert all(one.max() > 0.9 for one in fits)
        scores.append([float(proposals.scores[one.argmax()]) for one in fits])
    (both, *parts), (both_of_two, *parts_of_two) = scores
    assert both_of_two == pytest.approx(both)
    assert min(parts_of_two) > max(parts) + 0.05


def test_two_balls_of_two_colors_that_touch_are_less_likely_one_object() -> None:
    r = solids.rays()
    balls = [solids.sphere(r, solids.on_table(x, 0.8, 0.05), 0.05) for x in (0.0, 0.1)]
    frame, owner = solids.frame(balls, NOISE)
    scores = []
    for second in ((200, 180, 40), (40, 60, 190)):
        color = np.full((*owner.shape, 3), 120, np.uint8)
        color[owner == 1], color[owner == 2] = (200, 180, 40), second
        proposals = make_source("depth")(dataclasses.replace(frame, color=color), solids.CAMERA)
        fits = overlaps(proposals, owner > 0)
        assert fits.max() > 0.9
        scores.append(float(proposals.scores[fits.argmax()]))
    of_one_color, of_two_colors = scores
    assert of_two_colors < of_one_color - 0.03, "the groove between them is a border"


def test_table_and_floor_are_no_proposals() -> None:
    frame, _ = solids.frame([], NOISE)
    proposals = make_source("depth")(frame, solids.CAMERA)
    for k in range(len(proposals)):
        x0, y0, x1, y1 = proposals.boxes_xyxy[k]
        assert (x1 - x0) * (y1 - y0) < 0.05 * 640 * 480


def test_a_hole_in_a_thing_is_filled() -> None:
    frame, owner = solids.frame(ball_box_cup())
    depth_m = frame.depth_m.copy()
    rows, columns = np.nonzero(owner == 2)
    v, u = int(rows.mean()), int(columns.mean())
    depth_m[v - 10 : v + 10, u - 12 : u + 12] = 0.0
    proposals = make_source("depth")(Frame(0, 0.0, frame.color, depth_m), solids.CAMERA)
    best = whole_mask(proposals, int(np.argmax(overlaps(proposals, owner == 2))), owner.shape)
    assert best[v - 10 : v + 10, u - 12 : u + 12].mean() > 0.9


def test_the_sides_of_a_large_box_are_planes_and_proposed() -> None:
    size, turn = (0.4, 0.4, 0.35), 0.6
    center = solids.on_table(0.0, 1.0, 0.175)
    frame, owner = solids.frame([solids.box(solids.rays(), center, size, turn)], NOISE)
    proposals = make_source("depth")(frame, solids.CAMERA)
    points = solids.rays() * frame.depth_m[..., None]
    place = np.abs((points - center) @ solids.axes(turn).T) / (np.array(size) / 2)
    for side in range(3):
        face = (owner == 1) & (place.argmax(axis=-1) == side)
        assert overlaps(proposals, face).max() > 0.7, f"side {side}"
    assert overlaps(proposals, owner == 0).max() < 0.5, "the table is none"


def test_a_thing_beyond_a_metre_is_no_object() -> None:
    frame, owner = solids.frame([solids.sphere(solids.rays(), np.array([0.0, 0.0, 2.2]), 0.8)])
    proposals = make_source("depth")(frame, solids.CAMERA)
    assert len(proposals) == 0 or overlaps(proposals, owner == 1).max() < 0.5


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_masks_fill_their_rectangles_inside_the_image_at_any_scale(factor: int) -> None:
    frame, _ = solids.frame(ball_box_cup(), NOISE)
    small, camera = downscale(frame, factor), solids.CAMERA.downscaled(factor)
    proposals = make_source("depth")(small, camera)
    masks = proposals.full_masks()
    assert masks is not None
    assert len(proposals) >= 3
    for box, mask in zip(proposals.boxes_xyxy, masks, strict=True):
        x0, y0, x1, y1 = box
        assert 0 <= x0 < x1 <= camera.width
        assert 0 <= y0 < y1 <= camera.height
        assert mask.shape == (y1 - y0, x1 - x0)
        assert all(edge.any() for edge in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
    assert (np.diff(proposals.scores) <= 0).all()
    assert ((proposals.scores >= 0) & (proposals.scores <= 1)).all()


@pytest.mark.parametrize("depth", [0.0, 0.8, 9.0])
def test_a_frame_of_one_depth_has_no_proposals(depth: float) -> None:
    frame = Frame(0, 0.0, np.zeros((480, 640, 3), np.uint8), np.full((480, 640), depth, np.float32))
    assert len(make_source("depth")(frame, solids.CAMERA)) == 0


def test_the_same_frame_gives_the_same_proposals() -> None:
    frame, _ = solids.frame(ball_box_cup(), NOISE)
    one, two = (make_source("depth")(frame, solids.CAMERA) for _ in range(2))
    assert one.boxes_xyxy.tobytes() == two.boxes_xyxy.tobytes()
    assert one.scores.tobytes() == two.scores.tobytes()


def test_odd_sizes_are_taken() -> None:
    camera = Intrinsics(400.0, 400.0, 250.0, 150.0, 501, 303)
    frame, _ = solids.frame([solids.sphere(solids.rays(camera), solids.on_table(0.0, 0.9, 0.05), 0.05)], camera=camera)
    proposals = make_source("depth")(frame, camera)
    assert len(proposals) > 0
    assert (proposals.boxes_xyxy[:, 2] <= 501).all()
    assert (proposals.boxes_xyxy[:, 3] <= 303).all()


@pytest.mark.parametrize("options", ["fast", "119", "-320", "3.5"])
def test_widths_that_mean_nothing_are_refused(options: str) -> None:
    with pytest.raises(InputError, match=f"takes a width in pixels from 120 up, got '{options}'"):
        make_source(f"depth:{options}")


def test_most_objects_of_real_stills_are_proposed(data_dir: Path) -> None:
    folder = data_dir / "hots"
    camera = Intrinsics(570.342, 570.342, 319.5, 239.5, 640, 480)
    source = make_source("depth")
    found = wanted = proposed = stills = 0
    for still in json.loads((folder / "objects.json").read_text())["images"][::4]:
        color = cv2.imread(str(folder / f"{still['name']}.color.jpg"))[..., ::-1]
        depth = cv2.imread(str(folder / f"{still['name']}.depth.png"), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(folder / f"{still['name']}.mask.png"), cv2.IMREAD_UNCHANGED)
        frame = Frame(0, 0.0, np.ascontiguousarray(color), (depth / 1000.0).astype(np.float32))
        proposals = source(frame, camera)
        stills += 1
        proposed += len(proposals)
        for thing in still["objects"]:
            if thing["reportable"]:
                wanted += 1
                found += overlaps(proposals, mask == thing["id"]).max() >= 0.5
    assert found >= 0.85 * wanted
    assert proposed <= 45 * stills


def test_readings_beyond_the_range_are_background() -> None:
    depth = np.full((120, 160), 12.0, np.float32)
    depth[40:80, 60:100] = 1.0
    depth[:, :20] = 2.0
    frame = Frame(0, 0.0, np.zeros((120, 160, 3), np.uint8), depth)
    found = make_source(None)(frame, Intrinsics(130.0, 130.0, 79.5, 59.5, 160, 120))
    assert any(np.abs(box - [60, 40, 100, 80]).max() <= 4 for box in found.boxes_xyxy)


def test_the_sizes_and_the_range_of_objects_are_those_of_the_tracker() -> None:
    frame, _ = solids.frame(ball_box_cup(), NOISE)
    usual = make_source("depth")(frame, solids.CAMERA)
    longest = (usual.boxes_xyxy[:, 2:] - usual.boxes_xyxy[:, :2]).max(1)
    small = make_source("depth", TrackerConfig(max_size_m=0.1))(frame, solids.CAMERA)
    assert len(small) < len(usual)
    assert (small.boxes_xyxy[:, 2:] - small.boxes_xyxy[:, :2]).max() < longest.max()
    large = make_source("depth", TrackerConfig(min_size_m=0.15))(frame, solids.CAMERA)
    assert 0 < len(large) < len(usual)
    assert len(make_source("depth", TrackerConfig(max_depth_m=0.5, max_size_m=0.2))(frame, solids.CAMERA)) == 0
    noisy = make_source("depth", TrackerConfig(depth_noise_per_m=0.05))(frame, solids.CAMERA)
    assert len(noisy) < len(usual), "what noise of 5 cm at 1 m hides is not seen"
