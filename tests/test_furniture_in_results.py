"""Furniture in results and scenes: found unless refused, apart from the objects, with labels that last."""

from __future__ import annotations

import json
import shutil
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import networkx
import numpy as np
import pytest
from numpy.testing import assert_allclose
from rosbags.highlevel import AnyReader

import cuboid
from cuboid import cli
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import TrackedObject
from cuboid.lab.evaluation import evaluate
from cuboid.results.files import Results, read_objects
from cuboid.runs.scene import Scene
from cuboid.runs.tracking.furniture import labels_of
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.opening import open_place
from made_scenes import CAMERA
from made_table import CENTER_M, SIDES_M, THINGS, table_frames, write_table

SAME_FILES = ("tracks.csv", "proposals.csv", "map.ply", "trajectory.txt")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_table(tmp_path_factory.mktemp("furniture") / "recording")


@pytest.fixture(scope="module")
def plain(recording: Path) -> Path:
    return tracked(recording, recording.parent / "plain", "--no-furniture")


@pytest.fixture(scope="module")
def furnished(recording: Path) -> Path:
    """The results with furniture and relations; `summary.txt` and `summary.json` beside them have what was printed."""
    output = recording.parent / "furnished"
    with redirect_stdout(StringIO()) as printed:
        tracked(recording, output, "--relations", "--json", str(output.with_name("summary.json")))
    output.with_name("summary.txt").write_text(printed.getvalue())
    return output


def tracked(recording: Path, output: Path, *options: str) -> Path:
    assert cli.main(["track", str(recording), "--output", str(output), "--force", *options]) == 0
    return output


def entries(results: Path) -> list[dict[str, object]]:
    found: list[dict[str, object]] = json.loads((results / "objects.json").read_text())["objects"]
    return found


def refuse_other_box(table: TrackedObject) -> None:
    assert_allclose(np.sort(table.box.size), SIDES_M, atol=0.05)
    assert_allclose(table.box.center, CENTER_M, atol=0.05)
    assert_allclose(table.box.rotation[:, 2], [0, 0, 1], atol=0.02)


def test_a_table_is_one_piece_of_furniture_and_the_things_on_it_are_the_objects(furnished: Path) -> None:
    found = cuboid.open_results(furnished)
    (table,) = found.furniture
    refuse_other_box(table)
    assert len(found.objects) == len(THINGS)
    assert table.label not in [item.label for item in found.objects]
    assert table.kind == "support"
    assert {item.plane for item in found.objects} == set(table.planes), "it bears the plane that they stand on"
    assert table.plane not in (None, *table.planes), "it stands on the floor"
    assert {one.to for one in table.relations if one.kind == "supports"} == {item.label for item in found.objects}
    assert table.first_frame <= table.last_frame
    assert table.points > 100


def test_with_no_furniture_there_is_none_and_nothing_else_changes(furnished: Path, plain: Path) -> None:
    objects = [one for one in entries(furnished) if one.get("kind") != "support"]
    assert [{name: value for name, value in one.items() if name != "relations"} for one in objects] == entries(plain)
    assert len(entries(furnished)) == len(entries(plain)) + 1
    for name in SAME_FILES:
        assert (furnished / name).read_bytes() == (plain / name).read_bytes(), name
    assert Results(plain).furniture == []


def test_the_command_counts_furniture_apart(furnished: Path) -> None:
    assert "2 objects, 1 piece of furniture:" in furnished.with_name("summary.txt").read_text()
    kinds = [one.get("kind") for one in json.loads(furnished.with_name("summary.json").read_text())["objects"]]
    assert kinds == [None, None, "support"], "as in objects.json"


def test_evaluation_ignores_furniture(furnished: Path, plain: Path, tmp_path: Path) -> None:
    def box(k: int) -> dict[str, object]:
        thing = THINGS[k]
        place = {"center": thing.center.tolist(), "size": thing.size.tolist(), "rotation": thing.rotation.tolist()}
        return {"id": k + 1, "name": f"thing {k + 1}", "judged": True, **place}

    frames = len(Results(plain).poses)
    seen = {str(k + 1): [[1.0, frames]] for k in range(len(THINGS))}
    document = {"format": "cuboid-truth", "version": 1, "name": "table", "frames": frames}
    document |= {"objects": [box(k) for k in range(2)], "visibility": {"frames": frames, "objects": seen}}
    (tmp_path / "truth.json").write_text(json.dumps(document))
    with_it, without = (evaluate(one, tmp_path / "truth.json").to_dict() for one in (furnished, plain))
    assert with_it["map"]["boxes"] == without["map"]["boxes"] == 2
    for one in (with_it, without):
        one.pop("result")
    assert with_it == without


def test_things_on_a_table_are_found_by_its_label(furnished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (table,) = Results(furnished).furniture
    assert cli.main(["find", str(furnished), "--on", str(table.label), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["objects"]
    assert [one["label"] for one in found] == [item.label for item in Results(furnished).objects]
    assert cli.main(["find", str(furnished), "--on", "99"]) == 2


def test_things_on_a_table_are_found_in_a_store(
    recording: Path, furnished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(tmp_path / "store")
    options = ["--output", store, "--workers", "1", "--relations"]
    assert cli.main(["batch", str(recording), *options]) == 0
    capsys.readouterr()
    (table,) = Results(furnished).furniture
    assert cli.main(["find", store, "--on", str(table.label), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["objects"]
    assert {one["label"] for one in found} == {item.label for item in Results(furnished).objects}


def exported(results: Path, form: str, folder: Path) -> Path:
    assert cli.main(["export", str(results), "--to", form, "--output", str(folder / f"out.{form}")]) == 0
    return folder / f"out.{form}"


def test_the_graph_and_json_have_the_furniture_and_what_it_bears(furnished: Path, tmp_path: Path) -> None:
    (table,), objects = Results(furnished).furniture, [item.label for item in Results(furnished).objects]
    graph = networkx.read_graphml(exported(furnished, "graphml", tmp_path))
    node = f"object:{table.label}"
    assert (graph.nodes[node]["kind"], graph.nodes[node]["label"]) == ("support", table.label)
    ends = {(data["relation"], end) for _, end, data in graph.out_edges(node, data=True)}
    assert {("supports", f"object:{label}") for label in objects} <= ends
    assert {("bears", f"plane:{k}") for k in table.planes} <= ends
    features = json.loads(exported(furnished, "json", tmp_path).read_text())["features"]
    (piece,) = [one["properties"] for one in features if one["properties"]["kind"] == "support"]
    assert (piece["label"], piece["planes"]) == (table.label, list(table.planes))


def test_a_bag_shows_the_furniture_once(furnished: Path, tmp_path: Path) -> None:
    (table,) = Results(furnished).furniture
    with AnyReader([exported(furnished, "mcap", tmp_path)]) as bag:
        (found,) = [
            bag.deserialize(raw, one.msgtype) for one, _, raw in bag.messages() if one.topic == "/objects/furniture"
        ]
    assert {one.id for one in found.markers} == {table.label}
    cube = next(one for one in found.markers if one.ns == "boxes")
    assert_allclose([cube.scale.x, cube.scale.y, cube.scale.z], table.box.size, atol=1e-6)


def test_a_served_surface_names_the_furniture_that_bears_it(furnished: Path, plain: Path) -> None:
    (table,) = Results(furnished).furniture
    bearers = {one.surface: one.furniture for one in open_place(str(furnished)).surfaces()}
    assert bearers == {f"plane:{k}": table.label if k in table.planes else None for k in range(len(bearers))}
    assert len(set(bearers.values())) == 2
    assert {one.furniture for one in open_place(str(plain)).surfaces()} == {None}


def test_exports_of_objects_hold_the_objects_alone(furnished: Path, plain: Path, tmp_path: Path) -> None:
    for name, results in (("a", furnished), ("b", plain)):
        assert cli.main(["export", str(results), "--to", "csv", "--output", str(tmp_path / f"{name}.csv")]) == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_naming_an_object_keeps_the_furniture(furnished: Path, tmp_path: Path) -> None:
    results = shutil.copytree(furnished, tmp_path / "out")
    before = entries(results)
    found = Results(results)
    assert found.name(1, "box").name == "box"
    assert found.objects[0].name == "box"
    assert entries(results)[1:] == before[1:]


def test_things_on_a_table_are_found_by_the_name_of_the_table(
    furnished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = tmp_path / "named"
    shutil.copytree(furnished, results)
    found = Results(results)
    (table,) = found.furniture
    labels = [item.label for item in found.objects]
    assert cli.main(["find", str(results), "--on", "workbench"]) == 2
    found.name(table.label, "Workbench")
    assert [item.name for item in found.furniture] == ["Workbench"]
    capsys.readouterr()
    assert cli.main(["find", str(results), "--on", "workbench", "--json"]) == 0
    assert [one["label"] for one in json.loads(capsys.readouterr().out)["objects"]] == labels

    place = open_place(str(results))
    named = {f"plane:{k}": "Workbench" if k in table.planes else None for k in range(len(found.planes))}
    assert {one.surface: one.name for one in place.surfaces()} == named
    assert [node.name for node in place.tree() if node.of in ("plane:0", "plane:1")] == ["Workbench"]
    assert cli.main(["report", str(results), "--force"]) == 0
    assert '"name":"Workbench"' in (results / "report.html").read_text().replace(" ", "")
    capsys.readouterr()

    found.name(labels[0], "workbench")  # an object of that name as well: what is on either
    assert [one.label for one in open_place(str(results)).find(Filters(on="workbench"))] == labels
    found.name(table.label, "")
    assert cli.main(["find", str(results), "--on", "workbench", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["objects"] == []
    with pytest.raises(InputError, match="no object has the label 99"):
        found.name(99, "chair")


def test_a_label_is_kept_while_frames_go_on() -> None:
    tracker = cuboid.Tracker(CAMERA)
    frames = list(table_frames())
    for frame in frames[:12]:
        tracker.update(frame)
    (first,) = tracker.find_furniture()
    for frame in frames[12:]:
        tracker.update(frame)
    (second,) = tracker.find_furniture()
    assert second.label == first.label
    assert second.frames_seen > first.frames_seen
    assert first.label not in [item.label for item in tracker.objects]


def test_a_label_is_kept_over_the_recordings_of_a_scene(recording: Path, tmp_path: Path) -> None:
    scene = tmp_path / "place.cuboid"
    into = ("--same-world", "--scene", str(scene))
    one = tracked(recording, tmp_path / "one", *into)
    (before,) = Results(one).furniture
    with Scene.open(scene) as opened:
        opened.name(before.label, "table")
    two = tracked(write_table(tmp_path / "again", first_angle=0.2), tmp_path / "two", *into)
    (after,) = Results(two).furniture
    assert after.label == before.label
    assert after.name == "table", "a name stays in the scene"
    refuse_other_box(after)
    assert after.first_frame == 0
    assert after.last_frame < 24, "frames are those of the recording"
    assert [item.label for item in Results(two).objects] == [item.label for item in Results(one).objects]
    with Scene.open(scene) as opened:
        (known,) = opened.furniture
        assert known.label == before.label
        assert known.label not in [item.label for item in opened.objects]
        assert opened.furniture_planes == {known.label: known.planes}
        assert [piece.name for piece in opened.furniture] == ["table"]
        opened.write_results(tmp_path / "from scene")
        with pytest.raises(InputError, match="no object has the label 99"):
            opened.name(99, "chair")
    (written,) = Results(tmp_path / "from scene").furniture
    assert written.name == "table"
    assert (written.label, written.first_frame, written.planes) == (after.label, after.first_frame, known.planes)
    assert cli.main(["find", str(scene), "--on", str(before.label)]) == 0
    assert cli.main(["find", str(scene), "--on", "table"]) == 0
    with Scene.open(scene) as opened:
        opened.name(before.label, "")
        assert [piece.name for piece in opened.furniture] == [None]


def test_a_scene_of_runs_with_no_furniture_has_none(recording: Path, tmp_path: Path) -> None:
    tracked(recording, tmp_path / "out", "--no-furniture", "--limit", "12", "--scene", str(tmp_path / "place.cuboid"))
    with Scene.open(tmp_path / "place.cuboid") as scene:
        assert scene.furniture == []
        scene.write_results(tmp_path / "from scene")
    assert Results(tmp_path / "from scene").furniture == []


@pytest.mark.parametrize(
    ("pieces", "known", "expected"),
    [
        ([(1,), (2, 3)], {}, [(7,), (8,)]),
        ([(1,), (2, 3)], {1: (4,), 3: (2,)}, [(4,), (2,)]),
        ([(1, 2)], {1: (4,), 2: (2,)}, [(2, 4)]),  # two pieces turn out to be one: the older label stays
        ([(1,), (2,)], {1: (4,), 2: (4,)}, [(4,), (7,)]),  # one turns out to be two
    ],
)
def test_labels_follow_the_planes(
    pieces: list[tuple[int, ...]], known: dict[int, tuple[int, ...]], expected: list[tuple[int, ...]]
) -> None:
    fresh = iter((7, 8))
    assert labels_of(pieces, known, lambda: next(fresh)) == expected
    kept = [labels if any(k in known for k in planes) else () for planes, labels in zip(pieces, expected, strict=True)]
    if 7 not in [label for labels in kept for label in labels]:
        assert labels_of(pieces, known, None) == kept, "no new labels"


def test_furniture_on_a_plane_that_is_not_there_is_refused(furnished: Path, tmp_path: Path) -> None:
    document = json.loads((furnished / "objects.json").read_text())
    document["objects"][-1]["planes"] = [7]
    (tmp_path / "objects.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="furniture 3 bears plane 7 of 2 planes"):
        read_objects(tmp_path / "objects.json")
