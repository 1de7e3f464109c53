"""Questions to a place, answered from results whose relations are known."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.results.files.naming import name_object
from cuboid.services.queries.filters import Filters, both
from cuboid.services.queries.opening import is_place, open_place
from cuboid.services.queries.parameters import asked_of, filters_of, given
from cuboid.services.queries.place import Place
from made_place import OBJECTS, PLANES, write_place


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_place(tmp_path_factory.mktemp("place"))


@pytest.fixture(scope="module")
def place(results: Path) -> Place:
    return open_place(str(results))


def labels(place: Place, **filters: Any) -> list[int]:
    return [one.label for one in place.find(Filters(**filters))]


@pytest.mark.parametrize(
    ("filters", "expected"),
    [
        ({}, [1, 2, 3, 4, 5]),
        ({"name": "MUG"}, [5]),
        ({"name": "bowl"}, [5]),  # the next likely class
        ({"name": "bottle"}, []),  # too unlikely
        ({"size_m": (0.25, 1.0)}, [1, 4]),
        ({"min_probability": 0.8, "limit": 2}, [1, 2]),
        ({"color": "red"}, [5]),
        ({"on": "plane:0"}, [4]),
        ({"on": "plane:1"}, [1, 3]),
        ({"on": "3"}, [5]),
        ({"on": "#7"}, [5]),  # a label that was merged
        ({"inside": "crate"}, [2]),
        ({"on": "3", "name": "crate"}, []),
        ({"near": (0.3, 0.0, 0.7), "within_m": 0.2}, [5, 3]),
        ({"near_object": "mug", "within_m": 0.1}, [3]),
        ({"order": "tallest"}, [2]),
        ({"order": "largest", "on": "plane:1"}, [1]),
        ({"order": "nearest", "near_object": "can", "within_m": 9.0}, [1]),
        ({"near": (0.3, 0.0, 0.7), "near_object": "mug", "within_m": 0.2}, [3]),
        ({"since": datetime(2026, 3, 1, 12, 0, 4, tzinfo=UTC)}, [1, 2, 3, 5]),
        ({"until": datetime(2026, 3, 1, 12, 0, 4, tzinfo=UTC)}, [4]),
    ],
)
def test_filters(place: Place, filters: dict[str, Any], expected: list[int]) -> None:
    assert labels(place, **filters) == expected


@pytest.mark.parametrize(
    "filters", [{"on": "3"}, {"inside": "crate"}, {"beside": "mug"}, {"on": "plane:1", "name": "crate"}]
)
def test_in_a_large_map_relations_around_a_thing_are_those_of_the_whole(
    results: Path, place: Place, filters: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cuboid.services.queries.shared_map.SMALL", 1)
    monkeypatch.setattr("cuboid.services.queries.snapshot.RELATED_M", 0.3)
    large = open_place(str(results))
    assert large.find(Filters(**filters)) == place.find(Filters(**filters))
    assert [large.object(k).relations for k in (1, 2, 5)] == [place.object(k).relations for k in (1, 2, 5)]


@pytest.mark.parametrize(
    ("side", "of", "expected"),
    [
        ("left of", "mug", [1, 2]),
        ("right of", "crate", [3, 5, 4]),
        ("right of", "mug", [4]),
        ("behind", "mug", []),
        ("in front of", "mug", []),
    ],
)
def test_sides_are_those_that_the_camera_of_the_last_sighting_saw(
    place: Place, monkeypatch: pytest.MonkeyPatch, side: str, of: str, expected: list[int]
) -> None:
    source = type(place._shared.source)
    seen = source.last_seen

    def from_the_front(self: Any, item: Any) -> Any:
        return replace(seen(self, item), camera_m=(0.0, -2.0, 1.5))

    monkeypatch.setattr(source, "last_seen", from_the_front)
    assert sorted(labels(place, side=(side, of))) == sorted(expected)
    assert labels(place, side=("behind", "5")) == labels(place, side=("behind", "mug"))


def test_an_answer_has_box_times_and_relations(place: Place) -> None:
    mug = place.object(5)
    assert (mug.name, mug.state, mug.color, mug.plane) == ("mug", "present", "red", 1)
    assert mug.center_m == pytest.approx((0.3, 0.0, 0.58))
    assert mug.size_m == pytest.approx((0.08, 0.08, 0.1))
    assert mug.last_seen.time == "2026-03-01T12:00:05.000+00:00"
    assert mug.relations is not None
    assert [(one.kind, one.to) for one in mug.relations] == [("on", 3)]
    assert place.object(7).label == 3
    assert [(one.kind, one.name) for one in place.object(1).relations or () if one.kind == "supports"] == [
        ("supports", "can")
    ]


def test_wrong_questions_are_one_line(place: Place, tmp_path: Path) -> None:
    for question, said in (
        ({"on": "lamp"}, "no present object has the label or the name 'lamp'"),
        ({"recording": "kitchen*"}, "recording: this filter needs a store"),
        ({"like": ("kitchen", 1)}, "like: this filter needs a store"),
    ):
        with pytest.raises(InputError, match=said):
            place.find(Filters(**question))
    with pytest.raises(InputError, match="no object has the label 99"):
        place.object(99)
    with pytest.raises(InputError, match="expected a surface, plane:0 to plane:1, got 'wall:0'"):
        place.free_place("wall:0", 0.1, 0.1)
    with pytest.raises(InputError, match="above 0 metres"):
        place.free_place("plane:1", 0.1, -0.1)
    with pytest.raises(InputError, match="there is no such scene file"):
        open_place(str(tmp_path / "none.cuboid"))
    old = write_place(tmp_path, begin_s=0.0)
    with pytest.raises(InputError, match="no calendar times"):
        open_place(str(old)).find(Filters(since=datetime(2026, 3, 1, tzinfo=UTC)))


def test_surfaces_and_the_tree(place: Place) -> None:
    low, high = place.surfaces()
    assert (low.surface, low.height_m, low.objects) == ("plane:0", 0.0, (4,))
    assert (high.surface, high.height_m, high.area_m2, high.objects) == ("plane:1", 0.5, 4.0, (1, 3))
    assert (low.kind, high.kind) == ("floor", "table")
    table, floor = place.tree()
    assert [(one.name, [child.name for child in one.children]) for one in table.children] == [
        ("crate", ["can"]),
        (None, ["mug"]),
    ]
    assert [one.of for one in floor.children] == [4]


def test_the_nearest_free_place_is_free_and_near(place: Place) -> None:
    found = place.free_place("plane:1", 0.2, 0.1, near="crate")
    assert found is not None
    center, along = np.array(found.center_m), np.array(found.along)
    assert center[2] == pytest.approx(0.5)
    assert np.linalg.norm(along) == pytest.approx(1.0)
    across = np.cross([0, 0, 1.0], along)
    corners = [center + a * 0.1 * along + b * 0.05 * across for a in (-1, 1) for b in (-1, 1)]
    steps = np.linspace(-1, 1, 9)
    inside = [center + a * 0.1 * along + b * 0.05 * across for a in steps for b in steps]
    assert np.abs(corners).max(axis=0)[:2] == pytest.approx(np.minimum(np.abs(corners).max(axis=0)[:2], 1.0))
    for item in (OBJECTS[0], OBJECTS[2]):
        away = np.abs(np.array(inside) - item.box.center)[:, :2] - item.box.size[:2] / 2
        assert (away.max(axis=1) > 0).all(), "it lies in no object"
    # the crate is 25 cm wide: beside it, 10 cm wide, the nearest middle is 17.5 cm away and a clearance
    assert 0.17 < found.distance_m < 0.21
    assert place.free_place("plane:1", 1.9, 1.9) is None
    assert place.free_place("plane:0", 0.4, 0.4, near="2,0,0").distance_m > 0.3  # type: ignore[union-attr]


def test_history_last_sighting_picture_and_cloud(place: Place) -> None:
    history = place.history(4, limit=2)
    assert (history.count, [one.frame for one in history.sightings]) == (3, [0, 2])
    (parcel,) = place.last_seen("4")
    assert (parcel.label, parcel.last_seen.frame) == (4, 2)
    with pytest.raises(InputError, match="no object has the name 'lamp'; names: 'bowl', 'can', 'crate', 'mug'"):
        place.last_seen("lamp")
    picture = place.picture(1)
    assert picture is not None
    assert picture[:2] == b"\xff\xd8"
    assert len(place.cloud(1)) == 10


def test_changes_of_the_files_are_seen(tmp_path: Path) -> None:
    results = write_place(tmp_path)
    place = open_place(str(results))
    assert place.about().changes == 0
    name_object(results, 4, "parcel")
    until_s = time.monotonic() + 20.0
    while not place.changes.after(0) and time.monotonic() < until_s:  # a map is read again only now and then
        place.refresh()
    (change,) = place.changes.after(0)
    assert (change.change, change.label, change.name) == ("renamed", 4, "parcel")
    assert labels(place, name="parcel") == [4]


def test_find_takes_results(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert is_place(str(results))
    assert not is_place(str(results.parent))
    assert main(["find", str(results), "--in", "crate", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["objects"]
    assert (row["recording"], row["label"], row["name"]) == ("results", 2, "can")
    assert row["longest_m"] == pytest.approx(0.2)
    assert main(["find", str(results), "--beside", "lamp"]) == 2
    assert "name 'lamp'" in capsys.readouterr().err


def test_planes_are_those_of_the_results(place: Place) -> None:
    assert [one.center_m[2] for one in place.surfaces()] == [one.extent[0, 2] for one in PLANES]


def test_two_sets_of_conditions_hold_together() -> None:
    early, late = datetime(2026, 3, 1, tzinfo=UTC), datetime(2026, 3, 2, tzinfo=UTC)
    first = Filters(size_m=(0.1, 1.0), color="red", since=early, until=late, near_object="mug", within_m=1.0)
    second = Filters(size_m=(0.0, 0.3), color="red", since=late, until=early, on="floor", limit=7)
    together = both(first, second)
    assert together == Filters(
        size_m=(0.1, 0.3),
        color="red",
        since=late,
        until=early,
        near_object="mug",
        within_m=1.0,
        on="floor",
        limit=7,
    )
    assert filters_of(given({**asked_of(together), "limit": "7"})) == together
    with pytest.raises(InputError, match="color: expected one condition, got 'red' and 'blue'"):
        both(first, Filters(color="blue"))
