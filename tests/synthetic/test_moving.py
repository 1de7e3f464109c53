"""Things that move while the camera runs: the truth says exactly where everything is, and what happens."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cuboid.ground.geometry import se3
from cuboid.lab.evaluation.truth import read_truth
from cuboid.lab.synthetic import make_scene, render_recording
from cuboid.lab.synthetic.footprint import gap_m, hull

SEEDS = (1, 4, 6, 7)


@pytest.fixture(scope="module")
def scenes():
    return {seed: make_scene("moving", seed, frames=640) for seed in SEEDS}


@pytest.mark.parametrize("seed", SEEDS)
def test_things_move_rigidly_and_only_while_an_event_says_so(scenes, seed):
    scene = scenes[seed]
    assert scene.events
    for body in scene.objects:
        own = [one for one in scene.events if one.id == body.id]
        if body.path is None:
            assert not own
            continue
        assert all(se3.is_rigid(T, 1e-9) for T in body.path[::20])
        for one in own:
            if one.event in ("moved", "gone"):
                np.testing.assert_allclose(body.path[one.begin], one.T_room_from, atol=1e-9)
            if one.T_room_to is not None:
                np.testing.assert_allclose(body.path[one.end], one.T_room_to, atol=1e-9)
                np.testing.assert_allclose(body.path[min(one.end + 5, 639)], one.T_room_to, atol=1e-9)
        # Nothing jumps while it can be seen.
        steps = np.linalg.norm(np.diff(body.path[:, :3, 3], axis=0), axis=1)
        assert np.count_nonzero(steps > 0.12) <= sum(one.event != "moved" for one in own)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_was_moved_stands_free_on_the_table_again(scenes, seed):
    scene = scenes[seed]
    gone = {one.id for one in scene.events if one.event == "gone"} - {o.id for o in scene.events if o.event == "back"}
    here = [body for body in scene.objects if body.id not in gone]
    plan = {body.id: hull(body.mesh().vertices[:, :2]) for body in here}
    for body in here:
        for other in here:
            if other.id < body.id and other.id not in body.touches:
                assert gap_m(plan[body.id], plan[other.id]) > 0.015


def test_a_moved_thing_has_moved_and_one_that_was_put_back_has_no_event(scenes):
    for scene in scenes.values():
        for one in scene.events:
            if one.event == "moved":
                assert np.linalg.norm(one.T_room_to[:3, 3] - one.T_room_from[:3, 3]) >= 0.149
        moved = {one.id for one in scene.events}
        for body in scene.objects:
            if body.path is not None and body.id not in moved:  # lifted, and put back
                assert np.linalg.norm(body.path[0][:3, 3] - body.path[-1][:3, 3]) < 0.011


def test_the_truth_file_has_boxes_in_each_frame_events_and_people(tmp_path):
    scene = make_scene("moving", 2, frames=60)
    moved = make_scene("moving", 2, frames=260)
    shown = render_recording(scene, tmp_path / "made", size=(64, 48))
    assert shown.objects
    document = json.loads((tmp_path / "made" / "truth.json").read_text())
    assert document["events"] == []
    assert len(document["agents"]) == len(scene.agents)
    from cuboid.lab.synthetic.truth import write_truth

    write_truth(tmp_path / "truth.json", moved, moved.intrinsics(64, 48), np.ones((260, len(moved.objects))))
    truth = read_truth(tmp_path / "truth.json")
    assert truth.events
    for item, body in zip(truth.objects, moved.objects, strict=True):
        for frame in (0, 100, 200, 259):
            expected = moved.box(body.at(frame))
            np.testing.assert_allclose(item.at(frame).center, expected.center, atol=2e-6)
            np.testing.assert_allclose(np.sort(item.at(frame).size), np.sort(expected.size), atol=2e-3)
    for one, agent in zip(truth.agents, moved.agents, strict=True):
        vertices = se3.transform(moved.T_world_room, agent.at(120).mesh().vertices)
        box = one.path.at(120, one.size)
        assert (np.abs((vertices - box.center) @ box.rotation) <= box.size / 2 + 1e-5).all()


def test_a_frame_shows_what_is_there_then(tmp_path):
    """A thing that was carried away is seen in its new place, and its old one is empty."""
    from cuboid.lab.synthetic.view import SceneView

    scene = make_scene("moving", 2, frames=260)
    one = scene.events[0]
    k = next(k for k, body in enumerate(scene.objects) if body.id == one.id)
    view = SceneView(scene, scene.intrinsics(160, 120))
    for frame in (0, one.end + 5):
        hits = view.render(frame, "clean").hits
        assert view.visible_fractions(frame, hits)[k] > 0.3
        points = (hits.eye + hits.rays * hits.depth_m[..., None])[view.labels(hits) == one.id]
        place = scene.objects[k].at(frame).mesh().vertices
        assert (points >= place.min(0) - 0.01).all()
        assert (points <= place.max(0) + 0.01).all()
