"""A place over HTTP and its WebSocket, asked as other programs do."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import msgspec
import numpy as np
import pytest
import trimesh
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from cuboid.results.files.naming import name_object
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.opening import open_place
from cuboid.services.service.endpoints import ENDPOINTS
from cuboid.services.service.openapi import SOCKET, openapi
from made_place import write_place
from served import refuses_large_bodies, served


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_place(tmp_path_factory.mktemp("served"))


@pytest.fixture(scope="module")
def address(results: Path) -> Iterator[str]:
    with served(str(results)) as where:
        yield where


def get(address: str, **headers: str) -> bytes:
    with urlopen(Request(address, headers=headers), timeout=30) as answer:
        content: bytes = answer.read()
        return content


def asked(address: str, question: str) -> Any:
    return json.loads(get(f"{address}/{question}"))


def refused(address: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    with pytest.raises(HTTPError) as error:
        urlopen(Request(address, method=method, headers=headers), timeout=30)
    with error.value as answer:
        return answer.code, answer.read().decode()


def socket_of(address: str) -> str:
    return f"ws://{urlsplit(address).netloc}{SOCKET}"


@pytest.mark.parametrize(
    ("question", "filters"),
    [
        ("", Filters()),
        ("?in=crate", Filters(inside="crate")),
        ("?min_probability=0.8", Filters(min_probability=0.8)),
        ("?on=plane:1&min_size=25cm", Filters(on="plane:1", size_m=(0.25, 1e9))),
        ("?near=0.3,0,0.6&within=20cm&limit=1", Filters(near=(0.3, 0.0, 0.6), within_m=0.2, limit=1)),
        ("?near_object=mug&name=&since=2026-03-01T12:00:04", Filters(near_object="mug")),
    ],
)
def test_objects_are_those_that_find_finds(address: str, results: Path, question: str, filters: Filters) -> None:
    found = open_place(str(results)).find(filters)
    assert found
    assert asked(address, f"api/objects{question}") == json.loads(msgspec.json.encode(found))


def test_every_address_of_the_table_answers_as_the_document_says(address: str) -> None:
    document = asked(address, "openapi.json")
    validate(document)
    assert document == openapi(secured=False)
    assert set(document["paths"]) == {one.path for one in ENDPOINTS}
    queries = {"/api/ask": "?q=the+red+mug", "/api/last-seen": "?what=mug"}
    queries |= {"/api/surfaces/{number}/free": "?length=10cm&width=8cm"}
    for one in ENDPOINTS:
        path = one.path.replace("{label}", "1").replace("{number}", "1") + queries.get(one.path, "")
        if one.path.endswith("/mesh"):
            continue  # the made recording shows nothing that a mesh is made of
        content = get(f"{address}{path}")
        body = document["paths"][one.path]["get"]["responses"]["200"]["content"]
        assert set(body) == {one.media}
        if one.media == "application/json":
            checker = Draft202012Validator({**body[one.media]["schema"], "components": document["components"]})
            assert list(checker.iter_errors(json.loads(content))) == []


def test_a_question_takes_further_conditions(address: str) -> None:
    for further, labels in (("", [1, 3]), ("&min_size=25cm", [1]), ("&name=crate", [1]), ("&limit=1", [1])):
        found = asked(address, f"api/ask?q=what+is+on+the+table{further}")
        assert [one["label"] for one in found["objects"]] == labels
    code, content = refused(f"{address}/api/ask?q=the+red+mug&color=blue")
    assert (code, json.loads(content)["error"]) == (400, "color: expected one condition, got 'red' and 'blue'")


def test_the_3d_page_of_results_without_one_is_made(address: str) -> None:
    assert b"<title>recording - cuboid</title>" in get(f"{address}/report.html")


def test_pictures_clouds_free_places_and_the_tree(address: str) -> None:
    assert get(f"{address}/api/objects/1/picture")[:2] == b"\xff\xd8"
    cloud = trimesh.load(trimesh.util.wrap_as_stream(get(f"{address}/api/objects/1/cloud")), file_type="ply")
    assert len(cloud.vertices) == 10
    free = asked(address, "api/surfaces/1/free?length=20cm&width=10cm&near=crate")
    assert (free["surface"], free["length_m"], free["width_m"]) == ("plane:1", 0.2, 0.1)
    assert np.linalg.norm(free["along"]) == pytest.approx(1.0)
    table, _ = asked(address, "api/tree")
    assert [child["name"] for child in table["children"]] == ["crate", None]
    assert asked(address, "api/objects/4/history?limit=2")["count"] == 3
    assert asked(address, "api/last-seen?what=mug")[0]["last_seen"]["frame"] == 5


def test_what_is_wrong_is_one_line(address: str) -> None:
    for question, status, said in (
        ("objects/99", 404, "no object has the label 99"),
        ("objects/one", 400, "label: expected a whole number from 0, got 'one'"),
        ("objects?size=3", 400, "unknown parameter 'size'"),
        ("objects?on=lamp", 400, "the name 'lamp'"),
        ("objects?color=mauve", 400, "unknown color"),
        ("objects?min_probability=7", 400, "min_probability: expected a number from 0 to 1, got '7'"),
        ("objects?min_size=50cm&max_size=10cm", 400, "min_size 50cm is larger than max_size 10cm"),
        ("objects?recording=kitchen", 400, "unknown parameter 'recording'"),
        ("surfaces/7/free?length=1cm&width=1cm", 400, "plane:0 to plane:1"),
        ("surfaces/1/free?length=1cm", 400, "above 0 metres"),
        ("surfaces/1/free?length=3m&width=3m", 404, "there is none"),
        ("objects/1/mesh?form=pdf", 400, "expected one of glb, obj, ply, stl"),
        ("last-seen", 400, "what is needed"),
        ("objects?limit=-1", 400, "limit: expected a whole number from 0, got '-1'"),
        ("objects?limit=0", 400, "limit: expected a whole number from 1, got '0'"),
        ("objects/4/history?limit=-1", 400, "limit: expected a whole number from 0, got '-1'"),
        ("changes?after=-1", 400, "after: expected a whole number from 0, got '-1'"),
    ):
        code, content = refused(f"{address}/api/{question}")
        assert (code, said in json.loads(content)["error"]) == (status, True), content


def test_it_is_read_only_and_answers_to_its_own_name(address: str) -> None:
    assert refused(f"{address}/api/objects", method="POST")[0] == 405
    assert refused(f"{address}/api", Host="evil.example")[0] == 400
    with pytest.raises(InvalidStatus), connect(socket_of(address), origin="http://evil.example"):
        pass


def test_a_body_is_refused_before_it_is_read(address: str) -> None:
    refuses_large_bodies(f"{address}/api")


def test_a_socket_takes_changes_after_a_whole_number(address: str) -> None:
    with connect(f"{socket_of(address)}?after=-1") as socket, pytest.raises(ConnectionClosed) as ended:
        socket.recv(timeout=30)
    assert ended.value.rcvd is not None
    assert (ended.value.rcvd.code, ended.value.rcvd.reason) == (1008, "after: expected a whole number from 0, got '-1'")


def test_where_others_can_reach_it_a_token_is_needed(results: Path) -> None:
    with served(str(results), "--host", "0.0.0.0", "--token", "secret words") as where:
        address = where.partition("/?token=")[0].replace("0.0.0.0", "127.0.0.1")
        assert refused(f"{address}/api")[0] == 401
        assert refused(f"{address}/openapi.json", Authorization="Bearer wrong")[0] == 401
        document = json.loads(get(f"{address}/openapi.json", Authorization="Bearer secret words"))
        validate(document)
        assert document["security"] == [{"token": []}]
        with pytest.raises(InvalidStatus), connect(socket_of(address)):
            pass
        with connect(socket_of(address), additional_headers={"Authorization": "Bearer secret words"}):
            pass


def test_changes_are_sent_as_they_happen(tmp_path: Path) -> None:
    results = write_place(tmp_path)
    with served(str(results)) as address:
        with connect(socket_of(address)) as socket:
            name_object(results, 4, "parcel")
            change = json.loads(socket.recv(timeout=30))
            assert (change["number"], change["change"], change["label"], change["name"]) == (1, "renamed", 4, "parcel")
            name_object(results, 4, "box")
            assert json.loads(socket.recv(timeout=30))["name"] == "box"
        assert [one["name"] for one in asked(address, "api/changes?after=1")] == ["box"]
        with connect(f"{socket_of(address)}?after=0") as later:
            assert [json.loads(later.recv(timeout=30))["number"] for _ in range(2)] == [1, 2]
        last = connect(socket_of(address))
    with last, pytest.raises(ConnectionClosed):  # the server has ended
        last.recv(timeout=30)
