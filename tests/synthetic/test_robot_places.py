"""Made scenes that robots see: a table from above, a tote, a shelf, a counter, flush stacks."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.lab.synthetic import Scene, make_scene
from cuboid.lab.synthetic.view import SceneView

SEEDS = (0, 1, 2, 3)


def in_picture(scene: Scene, frame: int, points: Float64Array) -> np.ndarray:
    """Tell which points (N, 3) of the room lie in a 640 x 480 picture of a frame."""
    seen = transform(inverse(scene.T_room_camera[frame]), points)
    pixel = scene.focal_px * seen[:, :2] / seen[:, 2:] + (319.5, 239.5)
    return np.asarray((seen[:, 2] > 0) & (pixel >= 0).all(1) & (pixel < (640, 480)).all(1))


@pytest.mark.parametrize("seed", SEEDS)
def test_an_overhead_camera_stands_still_and_sees_a_part_of_the_table(seed: int) -> None:
    scene = make_scene("overhead", seed, frames=30)
    places, sight = scene.T_room_camera[:, :3, 3], scene.T_room_camera[:, :3, 2]
    assert np.ptp(places, axis=0).max() < 0.003
    assert (sight[:, 2] < -0.9).all(), "it looks down"
    top = scene.surfaces[0]
    rim = np.array([[*top.at(np.cos(a), np.sin(a)), top.height_m] for a in np.linspace(0, 2 * np.pi, 24)])
    assert not in_picture(scene, 0, rim).all()
    assert sum(in_picture(scene, 0, o.mesh().vertices).mean() > 0.9 for o in scene.objects) >= 3


def test_overhead_cameras_are_held_in_any_roll() -> None:
    right = [make_scene("overhead", seed, frames=2).T_room_camera[0, :3, 0] for seed in range(8)]
    directions = np.degrees([np.arctan2(r[1], r[0]) for r in right])
    assert np.ptp(directions) > 180


@pytest.mark.parametrize("seed", SEEDS)
def test_things_in_a_tote_touch_and_stay_within_its_walls(seed: int) -> None:
    scene = make_scene("bin", seed, frames=10)
    (surface,) = scene.surfaces
    assert len(scene.objects) >= 4
    assert any(o.touches for o in scene.objects)
    for item in scene.objects:
        assert surface.contains(item.mesh().vertices[:, :2], 0.0)
    walls = next(f for f in scene.furniture if f.model.name == "tote").mesh().vertices
    assert walls[:, 2].max() > surface.height_m + 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_a_counter_is_seen_from_across_the_room(seed: int) -> None:
    scene = make_scene("counter", seed, frames=20)
    assert len(scene.objects) >= 4
    for item in scene.objects:
        middle = item.mesh().vertices.mean(0)
        far = np.linalg.norm(scene.T_room_camera[:, :3, 3] - middle, axis=1)
        assert (far > 1.8).all()
        assert (far < 4.5).all()
        assert 2.6 - middle[1] < 0.65, "the wall is behind it"


@pytest.mark.parametrize("seed", SEEDS)
def test_stacked_blocks_are_flush_and_books_lie_on_books(seed: int) -> None:
    scene = make_scene("stacks", seed, frames=10)
    blocks = [o for o in scene.objects if o.model.name == "block"]
    assert len(blocks) == 4
    for below, above in ((blocks[0], blocks[1]), (blocks[2], blocks[3])):
        one, other = below.mesh().vertices, above.mesh().vertices
        np.testing.assert_allclose(np.ptp(one[:, :2], axis=0), np.ptp(other[:, :2], axis=0))
        np.testing.assert_allclose(one[:, :2].min(0), other[:, :2].min(0))
        assert other[:, 2].min() == pytest.approx(one[:, 2].max())
        assert below.model.parts[0][1].color != above.model.parts[0][1].color
        assert above.id in below.touches
    assert sum(o.model.name == "book" for o in scene.objects) >= 4


@pytest.mark.parametrize("seed", SEEDS)
def test_each_compartment_of_a_shelf_has_things_that_fit(seed: int) -> None:
    scene = make_scene("shelf", seed, frames=20)
    assert len({o.surface for o in scene.objects}) >= 3
    gap_m = scene.surfaces[2].height_m - scene.surfaces[0].height_m
    for item in scene.objects:
        vertices = item.mesh().vertices
        assert np.ptp(vertices[:, 2]) < gap_m - 0.03
        far = np.linalg.norm(scene.T_room_camera[:, :3, 3] - vertices.mean(0), axis=1)
        assert (far < 1.6).all()


def test_boards_mirror_what_stands_on_them() -> None:
    """In two of five patches of a board the depth is that of the mirror image of what stands on it."""
    scene = make_scene("shelf", 1, frames=2)
    frame = SceneView(scene, Intrinsics(250.0, 250.0, 159.5, 119.5, 320, 240)).render(0, "clean")
    true_m, rays, eye = frame.hits.depth_m, frame.hits.rays, frame.hits.eye
    deeper = (frame.depth_m > true_m + 1e-3) & (true_m > 0)
    assert 0.002 < deeper.mean() < 0.2
    boards = np.unique([surface.height_m for surface in scene.surfaces])
    on_board = np.abs(eye[2] + true_m * rays[..., 2] - boards[0]) < 2e-3
    assert 0.03 < deeper[on_board].mean() < 0.4
    assert np.abs(frame.depth_m - true_m)[~deeper & (frame.depth_m > 0)].max() < 1e-3
    # Turned over, the image of a thing lies above its board, within the room, and in the thing.
    points = (eye + frame.depth_m[..., None] * rays)[deeper]
    seen_m = (eye[2] + true_m * rays[..., 2])[deeper]
    board_m = boards[np.abs(seen_m[:, None] - boards).argmin(1)]
    turned = points * (1, 1, -1) + np.stack([0 * board_m, 0 * board_m, 2 * board_m], axis=-1)
    low = np.min([part.mesh().vertices.min(0) for part in (*scene.objects, *scene.furniture)], axis=0)
    assert (turned[:, 2] > board_m - 1e-3).all()
    assert (turned > low).all()
    item = max(scene.objects, key=lambda o: sum(inside(o.mesh().vertices, turned)))
    assert inside(item.mesh().vertices, turned).sum() > 20, "some of it is a thing's"


def inside(vertices: Float64Array, points: Float64Array) -> np.ndarray:
    """Tell which points lie in the bounds of vertices, to 2 mm."""
    return np.asarray(((points > vertices.min(0) - 0.002) & (points < vertices.max(0) + 0.002)).all(1))
