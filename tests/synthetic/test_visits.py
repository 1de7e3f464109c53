"""Several recordings of one place, and the truth of what happened between them."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.synthetic import make_visits, render_visits
from cuboid.lab.synthetic.kinds import WAYS
from cuboid.lab.synthetic.visits import MIN_MOVE_M


@pytest.mark.parametrize("kind", WAYS)
def test_a_thing_keeps_its_number_and_its_shape(kind):
    scenes = make_visits(kind, 2, 3, frames=8)
    for before, after in itertools.pairwise(scenes):
        old, new = ({body.id: body for body in scene.objects} for scene in (before, after))
        assert len(new.keys() - old.keys()) <= 1
        assert len(old.keys() - new.keys()) == 1
        both = old.keys() & new.keys()
        far = {k: np.linalg.norm(before.box(old[k]).center - after.box(new[k]).center) for k in both}
        moved = [k for k in both if far[k] > 0.05]
        assert 1 <= len(moved) <= 2
        for k in both:
            assert np.allclose(np.sort(before.box(old[k]).size), np.sort(after.box(new[k]).size), atol=0.03)
        for k in moved:
            assert far[k] > 0.6 * MIN_MOVE_M
        assert {body.id for body in after.ghosts} == {*moved, *(old.keys() - new.keys())}
        assert not np.allclose(before.light.lamps[0].points, after.light.lamps[0].points)
        assert not np.allclose(before.T_room_camera, after.T_room_camera)
        assert np.array_equal(before.T_world_room, after.T_world_room)


def test_the_same_call_makes_the_same_visits():
    one, two = (make_visits("table", 5, 2, frames=6) for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.T_room_camera, b.T_room_camera)
        assert [body.id for body in a.objects] == [body.id for body in b.objects]
        assert all(np.array_equal(x.T_room_model, y.T_room_model) for x, y in zip(a.objects, b.objects, strict=True))


def test_visits_are_rendered_with_their_truth(tmp_path: Path):
    scenes = make_visits("table", 2, 2, frames=10)
    told = render_visits(scenes, tmp_path / "v", size=(96, 72), sensor="clean")
    assert json.loads((tmp_path / "v" / "visits.json").read_text()) == told
    first, second = (read_truth(tmp_path / "v" / f"visit-{k}") for k in (1, 2))
    rows = {row["id"]: row for row in told["visits"][1]["changes"]}
    assert {row["change"] for row in rows.values()} == {"unchanged", "moved", "gone", "new"}
    for truth, side in ((first, "from"), (second, "to")):
        for item in truth.objects:
            assert np.allclose(rows[item.id][side], item.box.center, atol=1e-6)
    gone = next(row for row in rows.values() if row["change"] == "gone")
    assert gone["to"] is None
    assert gone["empty_frames"] > 0
    with pytest.raises(OutputError, match="exists"):
        render_visits(scenes, tmp_path / "v")
    with pytest.raises(InputError, match="cannot be visited again"):
        make_visits("occluders", 1, 2)
