"""Made scenes that robots see: a table from above, a tote, a counter, flush stacks."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.core.frame import Float64Array
from cuboid.geometry.se3 import inverse, transform
from cuboid.synthetic import Scene, make_scene

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
