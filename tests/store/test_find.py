"""Objects are found by what people know of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from made_stores import BEGIN, colors_of, put_run, run_of, thing

from cuboid.cli import main
from cuboid.fleet.store.compact import compact
from cuboid.fleet.store.find import StoreObjects
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.ground.core.errors import InputError
from cuboid.services.queries.questions import last_seen


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    place = StoreFolder(str(tmp_path_factory.mktemp("found")))
    cup = {"longest_m": 0.12, "middle_m": 0.08, "shortest_m": 0.08}
    put_run(place, 1, [thing(1, **cup, color="red"), thing(2, longest_m=0.3, center_x_m=1.0)], recording="kitchen-1")
    half = [0.5 * (a + b) for a, b in zip(colors_of("red"), colors_of("blue"), strict=True)]
    put_run(
        place,
        2,
        [thing(1, **cup, colors=half, color="blue", center_x_m=1.2), thing(2, last_seen=BEGIN + timedelta(days=9))],
        recording="kitchen-2",
    )
    compact(place)
    put_run(place, 3, [thing(1, **cup, color="green", center_z_m=0.4)], recording="office/desk")
    put_run(place, 4, [thing(5)], recording="office/chair")
    put_run(place, 10, [thing(6, center_y_m=3.0)], recording="office/chair")  # done again, later
    return place.url


def found(capsys: pytest.CaptureFixture[str], store: str, *words: str) -> list[str]:
    assert main(["find", store, *words, "--json", "-"]) == 0
    rows: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["objects"]
    return [f"{row['recording']}#{row['label']}" for row in rows]


@pytest.mark.parametrize(
    ("words", "which"),
    [
        (("--size", "11..14cm"), {"kitchen-1#1", "kitchen-2#1", "office/desk#1"}),
        (("--size", "..110mm"), {"kitchen-2#2", "office/chair#6"}),
        (("--size", "0.2m.."), {"kitchen-1#2"}),
        (("--color", "red"), {"kitchen-1#1", "kitchen-2#1"}),
        (("--recording", "kitchen*", "--size", "8..14cm"), {"kitchen-1#1", "kitchen-2#1", "kitchen-2#2"}),
        (("--since", "2026-03-05"), {"kitchen-2#2"}),
        (("--until", "2026-03-05", "--color", "grey"), {"kitchen-1#2", "office/chair#6"}),
        (("--near", "0,0,0", "--within", "30cm", "--color", "red"), {"kitchen-1#1"}),
    ],
)
def test_filters(capsys: pytest.CaptureFixture[str], store: str, words: tuple[str, ...], which: set[str]) -> None:
    assert set(found(capsys, store, *words)) == which


def test_by_the_name_of_a_class(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """In files that are gathered, and in others."""
    place = StoreFolder(str(tmp_path / "named"))
    put_run(place, 1, [thing(1)], recording="old")
    assert found(capsys, place.url, "--name", "cup") == []
    guess = [{"name": "bowl", "score": 0.3}, {"name": "vase", "score": 0.01}]
    things = [thing(1, name="cup", name_score=0.9), thing(2, names=guess), thing(3, name="Cup", name_score=0.6)]
    put_run(place, 2, things, recording="new")
    for _ in range(2):
        assert set(found(capsys, place.url, "--name", "cup")) == {"new#1", "new#3"}
        assert found(capsys, place.url, "--name", "bowl") == ["new#2"]
        assert found(capsys, place.url, "--name", "vase") == []
        assert set(found(capsys, place.url)) == {"old#1", "new#1", "new#2", "new#3"}
        compact(place)
    assert main(["find", place.url, "--name", "cup"]) == 0
    assert "new#1 cup" in capsys.readouterr().out


def test_by_probability(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    place = StoreFolder(str(tmp_path))
    put_run(place, 1, [thing(1, probability=0.5), thing(2, probability=0.7)], recording="one")
    put_run(place, 2, [thing(1, probability=0.6)], recording="two")
    assert set(found(capsys, place.url, "--min-probability", "0.6")) == {"one#2", "two#1"}
    assert main(["find", place.url, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["objects"]
    assert [(row["recording"], row["label"], row["probability"]) for row in rows] == [
        ("one", 1, 0.5),
        ("one", 2, 0.7),
        ("two", 1, 0.6),
    ]


def test_by_what_things_are_on_in_and_beside(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    def relation(kind: str, to: int | str) -> dict[str, Any]:
        ends = {"label": to, "surface": None} if isinstance(to, int) else {"label": None, "surface": to}
        return {"kind": kind, **ends, "score": 0.9}

    place, on_table = StoreFolder(str(tmp_path)), relation("on", "plane:1")
    tray = thing(1, name="Tray", relations=[on_table, relation("supports", 2)])
    cup = thing(2, name="cup", relations=[relation("on", 1), relation("beside", 3)], center_x_m=0.1)
    jar = thing(3, name="jar", relations=[relation("in", 1), relation("beside", 2)], center_x_m=0.2)
    put_run(place, 1, [tray, cup, jar], recording="kitchen")
    put_run(place, 2, [thing(1, name="tray"), thing(2, relations=[on_table])], recording="office")
    store = place.url
    assert found(capsys, store, "--on", "tray") == ["kitchen#2"], "names in any case"
    assert found(capsys, store, "--on", "#1") == ["kitchen#2"]
    assert found(capsys, store, "--in", "TRAY") == ["kitchen#3"]
    assert found(capsys, store, "--beside", "cup", "--in", "1") == ["kitchen#3"]
    assert set(found(capsys, store, "--on", "plane:1")) == {"kitchen#1", "office#2"}
    assert main(["find", store, "--on", "lamp"]) == 2
    assert "no present object has the label or the name 'lamp'" in capsys.readouterr().err
    assert set(found(capsys, store, "--near-object", "jar", "--within", "14cm")) == {"kitchen#2"}
    assert set(found(capsys, store, "--near-object", "3", "--within", "25cm")) == {"kitchen#1", "kitchen#2"}


def test_the_nearest_and_the_most_alike_come_first(capsys: pytest.CaptureFixture[str], store: str) -> None:
    assert found(capsys, store, "--near", "1,0,0", "--within", "0.5m") == ["kitchen-1#2", "kitchen-2#1"]
    assert found(capsys, store, "--near", "0,3,0") == ["office/chair#6"], "of the newest run, not of the one before"
    alike = found(capsys, store, "--like", "kitchen-1#1")
    assert alike[:2] == ["kitchen-2#1", "office/desk#1"]
    assert "kitchen-1#1" not in alike
    assert found(capsys, store, "--like", "kitchen-1#1", "--limit", "1") == ["kitchen-2#1"]


def test_a_store_answers_when_something_was_last_seen(tmp_path: Path) -> None:
    """The question is the one that a scene, results and a run answer, see `tests/queries`."""
    place = StoreFolder(str(tmp_path))
    put_run(place, 1, [thing(1, name="cup"), thing(2, last_seen=BEGIN + timedelta(days=2))], recording="kitchen")
    put_run(place, 2, [thing(2, name="Cup", last_seen=BEGIN + timedelta(days=1))], recording="office")
    objects = StoreObjects(Tables(place.url))
    assert [(row["recording"], row["label"]) for row in last_seen(objects, "cup")] == [("office", 2), ("kitchen", 1)]
    assert [row["recording"] for row in last_seen(objects, "#2")] == ["kitchen", "office"]
    with pytest.raises(InputError, match="no object has the name 'lamp'; names: 'cup'"):
        last_seen(objects, "lamp")


def test_pages_show_names_as_text(store: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = StoreFolder(str(tmp_path / "store"))
    put_run(place, 1, [thing(1, picture=b"\xff\xd8jpeg")], recording="<script>alert(1)</script>")
    assert main(["find", place.url, "--html", str(tmp_path / "found.html")]) == 0
    assert main(["store", "compact", place.url]) == 0
    for page in (tmp_path / "found.html", tmp_path / "store" / "index.html"):
        assert "<script>alert" not in page.read_text()
        assert "&lt;script&gt;" in page.read_text()
    assert "data:image/jpeg;base64," in (tmp_path / "found.html").read_text()


def test_the_worst_come_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = StoreFolder(str(tmp_path))
    put_run(place, 1, [thing(1)], recording="good")
    put_run(place, 2, [thing(1)], recording="lost", frames_used=2)
    put_run(place, 3, [], recording="empty")
    put_run(place, 4, [thing(1), thing(2)], recording="double", overlapping=2)
    put_run(place, 5, [], recording="broken", state="failed", reason="no camera")
    assert main(["store", "compact", place.url]) == 0
    page = (tmp_path / "index.html").read_text()
    order = [page.index(f">{name}<") for name in ("broken", "double", "empty", "lost", "good")]
    assert order == sorted(order)
    assert "no camera" in page


def test_sql(capsysbinary: pytest.CaptureFixture[bytes], store: str) -> None:
    question = f"select recording, count(*) as n from objects where run = '{run_of(2)}' group by recording"
    assert main(["sql", store, question, "--csv"]) == 0
    assert capsysbinary.readouterr().out == b'"recording","n"\n"kitchen-2",2\n'
    values = (
        "select 1 as n, 'x' as t, null as z, 'nan'::float as f, '\\xff'::blob as b, date '2026-03-01' as d, [1, 2] as l"
    )
    assert main(["sql", store, values, "--json"]) == 0
    row = {"n": 1, "t": "x", "z": None, "f": None, "b": "/w==", "d": "2026-03-01", "l": [1, 2]}
    assert json.loads(capsysbinary.readouterr().out) == {"rows": [row]}
    assert main(["sql", store, question, "--csv", "--json"]) == 2


def test_what_a_compaction_did_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = StoreFolder(str(tmp_path))
    put_run(place, 1, [thing(1)], recording="one")
    put_run(place, 2, [thing(1)], recording="two")
    assert main(["store", "compact", place.url, "--json"]) == 0
    done = json.loads(capsys.readouterr().out)
    assert (done["runs"], done["removed"]) == (2, 0)
    assert set(done) == {"runs", "files_before", "files_after", "removed"}


def test_a_page_that_exists_is_replaced_with_force_only(
    store: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "found.html"
    page.write_text("mine")
    assert main(["find", store, "--html", str(page)]) == 2
    assert (page.read_text(), "exists; --force replaces it" in capsys.readouterr().err) == ("mine", True)
    assert main(["find", store, "--html", str(page), "--force"]) == 0
    assert page.read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("find", "STORE", "--like", "kitchen-1#9"), "recording 'kitchen-1' has no object 9"),
        (("find", "STORE", "--like", "garage#1"), "there is no recording 'garage'"),
        (("find", "STORE", "--color", "mauve"), "unknown color 'mauve'; known colors: black, grey"),
        (("sql", "STORE", "select nothing from objects"), '"nothing" not found'),
        (("sql", "STORE", "selec"), "syntax error"),
    ],
)
def test_a_wrong_question_is_one_line(
    refused: Callable[..., str], store: str, words: tuple[str, ...], said: str
) -> None:
    assert said in refused(*(store if word == "STORE" else word for word in words))


@pytest.mark.parametrize(
    "words",
    [
        ("--size", "5"),
        ("--size", "9..4cm"),
        ("--near", "1,2"),
        ("--since", "soon"),
        ("--like", "kitchen-1"),
        ("--within", "1ft"),
    ],
)
def test_a_wrong_call_is_one_line(capsys: pytest.CaptureFixture[str], words: tuple[str, str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["find", "store", *words])
    assert ended.value.code == 2
    err = capsys.readouterr().err
    assert words[0] in err
    assert "expected" in err
    assert err.count("\n") == 1
