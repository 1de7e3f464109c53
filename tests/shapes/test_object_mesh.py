from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

import cuboid
import made_shapes
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import MapPoints, Sighting
from cuboid.ground.geometry.box import Box
from cuboid.method.shapes import ObjectMesh, object_mesh
from cuboid.method.shapes.keeping import APART_RAD, ViewKeeper
from cuboid.method.shapes.views import MAX_FUSED_VIEWS, Candidate, chosen
from cuboid.results.files import Results
from made_scenes import CAMERA, look_at, upright
from made_shapes import BOXES, FRAMES

MM = 1e-3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Results:
    place = tmp_path_factory.mktemp("shapes")
    return cuboid.open_results(made_shapes.finished(place / "results", place / "recording"))


def off_faces_m(points: np.ndarray, box: Box) -> np.ndarray:
    """The distance of points from the surface of a box."""
    away = np.abs((points - box.center) @ box.rotation) - box.size / 2
    outside = np.linalg.norm(np.maximum(away, 0), axis=1)
    return np.where((away <= 0).all(1), -away.max(1), outside)


@pytest.mark.parametrize("label", [1, 2])
def test_the_mesh_lies_on_the_true_surface_and_covers_the_sides_that_were_seen(run: Results, label: int) -> None:
    mesh, box = run.mesh(label), BOXES[label]
    far = off_faces_m(mesh.vertices, box)
    assert np.median(far) < 1 * MM
    assert np.percentile(far, 95) < 3 * MM
    assert not mesh.guessed.any()
    own = (mesh.vertices - box.center) @ box.rotation
    assert np.ptp(own, axis=0) == pytest.approx(box.size, abs=8 * MM)
    top = np.abs(own[:, 2] - box.size[2] / 2) < 3 * MM
    assert np.ptp(own[top, 0]) * np.ptp(own[top, 1]) == pytest.approx(box.size[0] * box.size[1], rel=0.1)


def test_faces_look_outwards(run: Results) -> None:
    mesh = run.mesh(1)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - BOXES[1].center)
    assert (outwards > 0).mean() > 0.98


def test_vertices_have_the_color_of_their_object(run: Results) -> None:
    for label in BOXES:
        color = (label * np.array([53, 97, 31]) + 90) % 256
        assert np.median(np.abs(run.mesh(label).rgb.astype(int) - color).max(1)) <= 3


def test_a_hole_stays_until_it_is_asked_to_be_closed_and_what_is_guessed_is_marked(run: Results) -> None:
    bare, closed, complete = run.mesh(1), run.mesh(1, close=True), run.mesh(1, complete=True)
    foot = BOXES[1].center[2] - BOXES[1].size[2] / 2
    assert bare.vertices[:, 2].min() > foot + 3 * MM
    for mesh in (closed, complete):
        assert mesh.vertices[:, 2].min() == pytest.approx(foot, abs=0.1 * MM)
        at_foot = np.abs(mesh.vertices[:, 2] - foot) < 1 * MM
        assert mesh.guessed[at_foot].all()
    solid = complete.to_trimesh()
    assert solid.is_watertight
    assert solid.volume == pytest.approx(BOXES[1].volume, rel=0.05)
    assert not bare.to_trimesh().is_watertight


def test_what_belongs_to_another_object_is_left_out() -> None:
    left, right = upright((-0.05, 0.0), (0.1, 0.1, 0.1)), upright((0.055, 0.0), (0.1, 0.1, 0.16))
    from cuboid.method.shapes.views import view_of
    from made_scenes import frame_of

    poses = [look_at((0.8 * np.cos(a), 0.8 * np.sin(a), 0.5), (0, 0, 0.05)) for a in np.linspace(0, 5.8, 12)]
    taken = [frame_of([made_shapes.TABLE, left, right], T, k) for k, T in enumerate(poses)]
    item = cuboid.TrackedObject(1, left, 0.9, 0.9, 0, 11, 12, 9, np.zeros(3), None)
    views = [view for f, T in zip(taken, poses, strict=True) if (view := view_of(f, CAMERA, T, left)) is not None]
    steps = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 12)] * 3), -1).reshape(-1, 3)
    xyz = np.concatenate([box.center + steps * box.size for box in (left, right)]).astype(np.float32)
    label = np.repeat([1, 2], len(steps)).astype(np.int32)
    points = MapPoints(xyz, np.zeros((len(xyz), 3), np.uint8), np.ones(len(xyz), np.float32), label)
    mesh = object_mesh(item, views, [], points)
    assert len(mesh.faces)
    assert mesh.vertices[:, 0].max() < 0.006


def test_views_are_of_many_sides_and_only_from_where_it_stands_now() -> None:
    box, elsewhere = upright((0, 0), (0.1, 0.1, 0.1)), upright((1, 1), (0.1, 0.1, 0.1))
    angles = np.concatenate([np.zeros(200), np.linspace(0, 3, 60)])
    poses = [look_at((np.cos(a), np.sin(a), 0.5), (0, 0, 0)) for a in angles]
    seen = [Candidate(k, elsewhere if k < 20 else box, 0.9, T) for k, T in enumerate(poses)]
    seen[230] = Candidate(230, box, 0.1, poses[230])
    taken = chosen(seen, box)
    frames = [one.frame for one in taken]
    assert len(frames) == MAX_FUSED_VIEWS
    assert frames == sorted(frames)
    assert min(frames) >= 20
    assert 230 not in frames
    assert sum(frame >= 200 for frame in frames) >= MAX_FUSED_VIEWS - 2


def test_kept_views_make_the_same_mesh_without_the_recording(run: Results, tmp_path: Path) -> None:
    folder = made_shapes.finished(tmp_path / "results", tmp_path / "recording", keep_views=True)
    shutil.rmtree(tmp_path / "recording")
    mesh = cuboid.open_results(folder).mesh(2)
    far = off_faces_m(mesh.vertices, BOXES[2])
    assert np.median(far) < 1 * MM
    assert len(mesh.faces) == pytest.approx(len(run.mesh(2).faces), rel=0.1)
    with zipfile.ZipFile(folder / "views.zip") as archive:
        assert len(archive.namelist()) <= 2 * 2 * FRAMES + 1
    (folder / "views.zip").write_bytes(b"no archive")
    with pytest.raises(InputError, match="expected views of objects"):
        cuboid.open_results(folder).mesh(2)


def test_a_tracker_answers_with_the_views_that_it_kept() -> None:
    tracker = cuboid.Tracker(CAMERA, poses="given", shapes=True)
    for frame in made_shapes.frames():
        tracker.update(frame)
    assert len(tracker.objects) == 2
    for item in tracker.objects:
        true = min(BOXES.values(), key=lambda box: float(np.linalg.norm(box.center - item.box.center)))
        assert np.median(off_faces_m(tracker.mesh(item.label).vertices, true)) < 2 * MM
    bare = cuboid.Tracker(CAMERA, poses="given")
    for frame in made_shapes.frames():
        bare.update(frame)
    label = bare.objects[0].label
    with pytest.raises(InputError, match="shapes=True"):
        bare.mesh(label)


def test_the_number_of_kept_views_is_bounded() -> None:
    keeper, box = ViewKeeper(CAMERA), BOXES[1]
    frame = made_shapes.frames()[0]
    rng, places = np.random.default_rng(1), 400
    for _ in range(places):
        eye = rng.normal(size=3)
        eye[2] = abs(eye[2]) + 0.3
        T = look_at(box.center + 0.9 * eye / np.linalg.norm(eye), box.center)
        keeper.add(frame, T, [Sighting(1, box, None, 0.9, np.zeros(4))])
    kept = keeper._views[1]
    assert 10 < len(kept) <= MAX_FUSED_VIEWS
    assert keeper._bytes == sum(view.size for view in kept)
    assert keeper._apart_rad[1] > APART_RAD
    keeper.add(frame, T, [Sighting(1, upright((0.5, 0.5), (0.1, 0.1, 0.1)), None, 0.9, np.zeros(4))])
    assert len(keeper._views[1]) <= 1, "it stands elsewhere now"


def test_views_that_are_left_out_are_a_warning_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def saved(name: str) -> tuple[str, ...]:
        tracker = cuboid.Tracker(CAMERA, poses="given", shapes=True)
        for frame in made_shapes.frames():
            tracker.update(frame)
        tracker.save(tmp_path / name)
        return tuple(line for line in cuboid.open_results(tmp_path / name).report.warnings if "views" in line)

    assert saved("whole") == ()
    monkeypatch.setattr("cuboid.method.shapes.keeping.MAX_VIEW_BYTES", 100_000)
    (line,) = saved("small")
    assert re.match(r"\d+ views of 2 objects were left out: together, views are limited to 0 MB", line)


def test_a_mesh_goes_through_a_file_with_colors_and_what_is_guessed(run: Results, tmp_path: Path) -> None:
    mesh = run.mesh(1, close=True)
    mesh.to_trimesh().export(tmp_path / "one.ply")
    loaded = trimesh.load(tmp_path / "one.ply", process=False)
    np.testing.assert_allclose(loaded.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(loaded.faces, mesh.faces)
    np.testing.assert_array_equal(loaded.visual.vertex_colors[:, :3], mesh.rgb)
    header = (tmp_path / "one.ply").read_bytes().split(b"end_header")[0]
    assert b"guessed" in header


def test_an_object_that_no_view_shows_has_no_faces(run: Results) -> None:
    item = run.objects[0]
    mesh = object_mesh(item, [], run.planes, run.map_points())
    assert isinstance(mesh, ObjectMesh)
    assert len(mesh.faces) == 0


def test_without_recording_and_views_one_line_says_so(run: Results, tmp_path: Path) -> None:
    shutil.copytree(run.folder, tmp_path / "results")
    with pytest.raises(InputError):
        cuboid.open_results(tmp_path / "results", tmp_path / "nowhere").mesh(1)
