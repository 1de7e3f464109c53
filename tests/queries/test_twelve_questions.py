"""Twelve questions that people ask of recordings: one answer over the command line, HTTP, MCP, in Python, on pages."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, urlencode

import pytest

pytest.importorskip("duckdb")
pytest.importorskip("mcp")

from mcp.client.client import Client

from cuboid import open_results
from cuboid.cli import main
from cuboid.fleet.store import find as in_store
from cuboid.fleet.store.asgi import application as store_application
from cuboid.fleet.store.mcp import server_of as store_server
from cuboid.fleet.store.query import Tables
from cuboid.services.queries.opening import open_place
from cuboid.services.queries.parameters import filters_of
from cuboid.services.service.app import application
from cuboid.services.service.mcp import server_of
from made_answers import BEGIN_S, THINGS, into_scene, label_of, put_results, track
from made_place import BEGIN_S as PLACE_BEGIN_S
from made_place import write_place

# The recordings of the store, each with its begin in seconds; 0: without times. The copy has the morning's results.
RECORDINGS = {
    "morning": BEGIN_S,
    "copy": BEGIN_S,
    "evening": 0.0,
    "yesterday": BEGIN_S - 86400.0,
}
# Conditions of where an object is.
PLACES = {"on", "beside", "near_object"}
TABLE_THINGS = {"bin", "box", "red cup", "can"}


class Question(NamedTuple):
    """A question: in English, as conditions, and the names of the things that answer it in one recording."""

    english: str
    asked: dict[str, str]
    answer: set[str]


# `last` is the question where and when something was seen last; the other names are those of the conditions.
QUESTIONS = (
    Question("Where is the can?", {"last": "can"}, {"can"}),
    Question("When was the parcel last seen?", {"last": "parcel"}, {"parcel"}),
    Question("the blue bin beside the box", {"name": "bin", "color": "blue", "beside": "box"}, {"bin"}),
    Question("What is on the floor?", {"on": "floor"}, {"parcel"}),
    Question("what is on the table?", {"on": "table"}, TABLE_THINGS),
    Question("things beside the bin", {"beside": "bin"}, {"box", "red cup"}),
    Question("show me everything larger than 25 cm", {"min_size": "25cm"}, {"parcel"}),
    Question("small things on the table", {"max_size": "15cm", "on": "table"}, {"red cup"}),
    Question("the white things", {"color": "white"}, {"parcel"}),
    Question("things within 25 cm of the red cup", {"near_object": "red cup", "within": "25cm"}, {"bin", "can"}),
    Question("Is there a lamp on the table?", {"name": "lamp", "on": "table"}, set()),
    Question("anything seen since 2026-03-01", {"since": "2026-03-01"}, set(THINGS)),
)


@dataclass(frozen=True)
class Made:
    """The places, and the label of each thing in the results and in the scene."""

    results: Path
    scene: Path
    store: str
    labels: dict[str, int]
    in_scene: dict[str, int]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The results of a morning; a scene of two days, the can away on the second; a store of four recordings."""
    folder = tmp_path_factory.mktemp("asked")
    tracked = {name: track(folder, name, RECORDINGS[name]) for name in ("morning", "evening", "yesterday")}
    morning = tracked["copy"] = tracked["morning"]
    store, scene = str(folder / "store"), folder / "room.cuboid"
    into_scene(scene, BEGIN_S)
    labels = {name: label_of(open_results(morning).objects, name) for name in THINGS}
    in_scene = {name: label_of([one for one, _ in open_place(str(scene))._source.objects()], name) for name in THINGS}
    into_scene(scene, BEGIN_S + 86400.0, without="can")
    for number, (name, results) in enumerate(tracked.items(), 1):
        put_results(store, results, name, number)
    for path, known in ((morning, labels), (scene, in_scene)):
        assert main(["name", str(path), *(f"{label}={name}" for name, label in known.items())]) == 0
    given = [f"{one}#{label}={name}" for one in RECORDINGS for name, label in labels.items()]
    assert main(["name", store, *given]) == 0
    return Made(morning, scene, store, labels, in_scene)


async def _answer(app: Any, address: str) -> tuple[int, bytes]:
    path, _, query = address.partition("?")
    headers = [(b"host", b"127.0.0.1")]
    scope = {"type": "http", "http_version": "1.1", "method": "GET", "scheme": "http", "path": path, "root_path": ""}
    scope |= {"raw_path": path.encode(), "query_string": query.encode(), "headers": headers}
    scope |= {"client": ("127.0.0.1", 1), "server": ("127.0.0.1", 80)}
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    await app(scope, receive, send)
    return sent[0]["status"], b"".join(one.get("body", b"") for one in sent[1:])


def got(app: Any, address: str) -> tuple[int, Any]:
    """Ask an ASGI application; return status and document, or the text of a page."""
    status, body = asyncio.run(_answer(app, address))
    return status, json.loads(body) if body[:1] in b"[{" else body.decode()


def of_http(app: Any) -> Callable[[Question], tuple[list[Any], list[Any]]]:
    def ask(question: Question) -> tuple[list[Any], list[Any]]:
        last = question.asked.get("last")
        address = f"/api/last-seen?what={quote(last)}" if last else f"/api/objects?{urlencode(question.asked)}"
        (_, found), (_, english) = got(app, address), got(app, f"/api/ask?q={quote(question.english)}")
        return found["objects"] if isinstance(found, dict) else found, english["objects"]

    return ask


def of_page(app: Any) -> Callable[[Question], tuple[list[Any], list[Any]]]:
    """The labels and recordings of the cards on the page: of a question of its fields, and of one in English."""

    def cards(**asked: str) -> list[Any]:
        status, page = got(app, f"/?{urlencode(asked)}")
        assert status == 200, page
        labels = [int(one) for one in re.findall(r'<span class="chip"[^>]*>#(\d+)', page)]
        recordings = re.findall(r'<p class="whose">([^<]*)', page) or [""] * len(labels)
        states = ["gone" if "looked for and gone" in one else "present" for one in page.split('<li class="card"')[1:]]
        return [
            {"label": label, "recording": name, "state": state}
            for label, name, state in zip(labels, recordings, states, strict=True)
        ]

    def ask(question: Question) -> tuple[list[Any], list[Any]]:
        last = question.asked.get("last")
        by_fields = cards(q=f"where is {last}") if last else cards(**question.asked)
        return by_fields, cards(q=question.english)

    return ask


def of_mcp(server: Any) -> Callable[[Question], tuple[list[Any], list[Any]]]:
    def ask(question: Question) -> tuple[list[Any], list[Any]]:
        asked: dict[str, Any] = {**question.asked, **({} if "last" in question.asked else {"limit": 50})}
        for name in ("min_size", "max_size", "within"):
            if name in asked:
                asked[f"{name}_m"] = float(asked.pop(name).removesuffix("cm")) / 100

        async def call() -> tuple[list[Any], list[Any]]:
            async with Client(server) as client:
                tool, values = ("last_seen", {"what": asked["last"]}) if "last" in asked else ("find_objects", asked)
                answers = [
                    await client.call_tool(tool, values),
                    await client.call_tool("ask", {"question": question.english, "limit": 50}),
                ]
            assert not any(one.is_error for one in answers), answers
            return answers[0].structured_content["result"], answers[1].structured_content["objects"]

        return asyncio.run(call())

    return ask


def of_python(path: str) -> Callable[[Question], tuple[list[Any], list[Any]]]:
    place = open_place(path)

    def ask(question: Question) -> tuple[list[Any], list[Any]]:
        last = question.asked.get("last")
        found = place.last_seen(last) if last else place.find(filters_of(question.asked))
        return [vars(one) for one in found], [vars(one) for one in place.ask(question.english).objects]

    return ask


def of_python_store(url: str) -> Callable[[Question], tuple[list[Any], list[Any]]]:
    tables = Tables(url)

    def ask(question: Question) -> tuple[list[Any], list[Any]]:
        last = question.asked.get("last")
        rows = in_store.last_seen(tables, last) if last else in_store.find(tables, filters_of(question.asked))
        return rows, in_store.ask(tables, question.english).rows

    return ask


def of_command(path: str, capsys: pytest.CaptureFixture[str]) -> Callable[[Question], tuple[list[Any], list[Any]]]:
    def found(*words: str) -> list[Any]:
        capsys.readouterr()
        assert main(["find", path, *words, "--json"]) == 0
        return json.loads(capsys.readouterr().out)["objects"]

    def ask(question: Question) -> tuple[list[Any], list[Any]]:
        asked = dict(question.asked)
        size = f"{asked.pop('min_size', '')}..{asked.pop('max_size', '')}"
        words = [word for name, value in asked.items() for word in (f"--{name.replace('_', '-')}", value)]
        return found(*words, *(["--size", size] if size != ".." else [])), found(question.english)

    return ask


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.english)
def test_results_answer_alike(made: Made, question: Question, capsys: pytest.CaptureFixture[str]) -> None:
    expected = {made.labels[name] for name in question.answer}
    path = str(made.results)
    place = open_place(path)
    app = application(place, token=None)
    for ask in (of_command(path, capsys), of_http(app), of_page(app), of_mcp(server_of(place)), of_python(path)):
        by_conditions, in_english = ask(question)
        assert {one["label"] for one in by_conditions} == expected
        assert {one["label"] for one in in_english} == expected


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.english)
def test_a_scene_answers_for_its_last_visit(made: Made, question: Question, capsys: pytest.CaptureFixture[str]) -> None:
    """The can is not there on the second day: on nothing, near nothing, and said to be gone."""
    gone = set() if PLACES & set(question.asked) else question.answer & {"can"}
    expected = {made.in_scene[name] for name in question.answer - {"can"} | gone}
    path = str(made.scene)
    place = open_place(path)
    if "since" in question.asked:  # all that was ever labelled, also what is no thing by itself
        everything = {one.label: one.state for one, _ in place._source.objects()}
        expected |= set(everything)
        gone = {label for label, state in everything.items() if state == "gone"}
    app = application(place, token=None)
    for ask in (of_command(path, capsys), of_http(app), of_page(app), of_mcp(server_of(place)), of_python(path)):
        for found in ask(question):
            assert {one["label"] for one in found} == expected
            states = [one["state"] for one in found]
            assert states == ["present"] * (len(found) - len(gone)) + ["gone"] * len(gone)


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.english)
def test_a_store_answers_for_each_recording(made: Made, question: Question, capsys: pytest.CaptureFixture[str]) -> None:
    recordings = ("morning", "copy") if "since" in question.asked else RECORDINGS
    expected = {(one, made.labels[name]) for one in recordings for name in question.answer}
    app = store_application(made.store, token=None)
    for ask in (
        of_http(app),
        of_page(app),
        of_mcp(store_server(made.store)),
        of_python_store(made.store),
        of_command(made.store, capsys),
    ):
        for found in ask(question):
            assert {(one["recording"], one["label"]) for one in found} == expected


def test_where_and_when_is_the_same_everywhere(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    (parcel,) = open_place(str(made.results)).last_seen("parcel")
    seen, later = parcel.last_seen, parcel.later
    assert (seen.frame, seen.time, seen.camera) == (11, "2026-03-01T12:00:00.366+00:00", "morning")
    assert seen.camera_m == pytest.approx((0.91, 1.47, 1.5), abs=0.01)
    assert seen.distance_m == pytest.approx(1.84, abs=0.01)
    assert later is not None
    assert (later.state, later.at) == ("not looked at", None)
    (can,) = open_place(str(made.scene)).last_seen("can")
    assert (can.state, can.last_seen.recording, can.last_seen.frame) == ("gone", 1, 17)
    assert can.later is not None
    assert can.later.state == "gone"
    assert can.later.at is not None
    assert can.later.at.recording == 2
    rows = {row["recording"]: row for row in in_store.last_seen(Tables(made.store), "parcel")}
    assert rows.keys() == RECORDINGS.keys()
    for row in rows.values():
        assert (row["last_frame"], row["later"]) == (11, "not looked at")
        assert row["camera_distance_m"] == pytest.approx(1.84, abs=0.01)
    days = {name: row["last_seen"] and str(row["last_seen"])[:10] for name, row in rows.items()}
    assert (days["morning"], days["yesterday"]) == ("2026-03-01", "2026-02-28")
    assert days["evening"] is None, "no date of a file"
    capsys.readouterr()
    assert main(["find", str(made.scene), "--last", "can"]) == 0
    assert "looked for and gone since recording 2, frame" in capsys.readouterr().out
    assert main(["find", made.store, "where is the parcel"]) == 0
    assert capsys.readouterr().out.count("not looked at since") == len(RECORDINGS)


def test_what_left_during_a_recording_is_in_every_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = write_place(tmp_path)
    document = json.loads((results / "objects.json").read_text())
    document["objects"] = [one for one in document["objects"] if one["label"] != 4]
    (results / "objects.json").write_text(json.dumps(document))
    header = "frame,timestamp,event,label,from_x,from_y,from_z,to_x,to_y,to_z,score"
    (results / "events.csv").write_text(f"{header}\n4,{PLACE_BEGIN_S + 4},gone,4,2,0,0.1,,,,1\n")
    store = str(tmp_path / "store")
    put_results(store, results, "morning", 1)
    place = open_place(str(results))
    stored, app = store_application(store, token=None), application(place, token=None)
    for path, asks in (
        (str(results), (of_http(app), of_page(app), of_mcp(server_of(place)), of_python(str(results)))),
        (store, (of_http(stored), of_page(stored), of_mcp(store_server(store)), of_python_store(store))),
    ):
        for question, expected in (
            (Question("things larger than 25 cm", {"min_size": "25cm"}, set()), [(1, "present"), (4, "gone")]),
            (Question("things on the crate", {"on": "crate"}, set()), []),
            (Question("where is 4", {"last": "4"}, set()), [(4, "gone")]),
        ):
            for ask in (*asks, of_command(path, capsys)):
                for found in ask(question):
                    assert [(one["label"], one["state"]) for one in found] == expected
        assert main(["find", path]) == 0
        assert "gone since frame 4" in capsys.readouterr().out
        assert main(["find", path, "--beside", "4"]) == 2
        assert "no present object has the label or the name '4'" in capsys.readouterr().err
    capsys.readouterr()
    assert main(["find", store, "--like", "morning#1"]) == 0
    assert "#4" not in capsys.readouterr().out
    assert main(["find", store, "--like", "morning#4"]) == 2
    assert "morning#4: a gone object has no shape and colors" in capsys.readouterr().err
    tables = Tables(store)
    assert [row["n"] for row in tables.rows("select count(*) as n from objects")] == [4]
    assert [row["label"] for row in tables.rows("select label from all_objects where gone")] == [4]


def test_the_picture_of_that_moment(made: Made, tmp_path: Path) -> None:
    place, app = open_place(str(made.results)), store_application(made.store, token=None)
    label = made.labels["parcel"]
    last, best = place.picture(label, last=True), place.picture(label)
    assert last is not None
    assert last[:2] == b"\xff\xd8"
    assert last != best
    assert main(["find", str(made.results), "--last", "parcel", "--picture", str(tmp_path / "last.jpg")]) == 0
    assert (tmp_path / "last.jpg").read_bytes() == last
    of_store = {asyncio.run(_answer(app, f"/api/objects/evening/{label}/picture{q}"))[1] for q in ("", "?last=true")}
    assert len(of_store) == 2
    assert main(["find", made.store, "--last", "parcel", "--picture", str(tmp_path / "of-store.jpg")]) == 0
    assert (tmp_path / "of-store.jpg").read_bytes() in of_store


def test_names_show_in_every_file_and_page(made: Made) -> None:
    assert '"name":"red cup"' in (made.results / "report.html").read_text(encoding="utf-8")
    _, front = got(application(open_place(str(made.results)), token=None), "/")
    assert "red cup" in front
    assert "not looked at since" in front
    _, in_3d = got(application(open_place(str(made.scene)), token=None), "/report.html")
    assert '"name":"red cup"' in in_3d
    _, page = got(store_application(made.store, token=None), "/?name=red+cup&recording=evening")
    assert f"#{made.labels['red cup']} red cup" in page


def test_what_is_not_known_is_said(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    known = "names: 'bin', 'box', 'can', 'parcel', 'red cup'"
    for path in (str(made.results), made.store):
        capsys.readouterr()
        assert main(["find", path, "--name", "lamp"]) == 0
        assert f"no object has the name 'lamp'; {known}" in capsys.readouterr().out
        assert main(["find", path, "the shiny lamp"]) == 2
        assert "not understood from 'shiny lamp' on" in capsys.readouterr().err
        assert main(["find", path, "--last", "lamp"]) == 2
        assert known in capsys.readouterr().err
    assert open_place(str(made.results)).ask("a lamp").note == f"no object has the name 'lamp'; {known}"


def test_an_address_that_does_not_exist_answers_json(made: Made) -> None:
    for app in (application(open_place(str(made.results)), token=None), store_application(made.store, token=None)):
        status, document = got(app, "/api/nothing")
        assert status == 404
        assert document["error"].startswith("there is no address '/api/nothing'; /openapi.json lists")
