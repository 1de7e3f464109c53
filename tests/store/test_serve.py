"""The pages and the API of a store, asked as a browser does."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from made_stores import put_run, thing

from cuboid.fleet.store.folder import StoreFolder
from served import refuses_large_bodies, served


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    place = StoreFolder(str(tmp_path_factory.mktemp("served")))
    folder = "results/kitchen/00000000000000000001"
    put_run(place, 1, [thing(1, color="red"), thing(2)], recording="kitchen", results=folder)
    place.put(f"{folder}/report.html", b"<!doctype html><title>a run</title>")
    place.put(f"{folder}/secret.txt", b"mine")
    return place.url


@pytest.fixture(scope="module")
def address(store: str) -> Iterator[str]:
    with served(store) as where:
        yield where


def get(address: str, **headers: str) -> bytes:
    with urlopen(Request(address, headers=headers), timeout=20) as answer:
        content: bytes = answer.read()
        return content


def refused(address: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    with pytest.raises(HTTPError) as error:
        urlopen(Request(address, method=method, headers=headers), timeout=20)
    with error.value as answer:
        return answer.code, answer.read().decode()


def test_the_api_answers_what_find_finds(address: str, store: str) -> None:
    found: dict[str, Any] = json.loads(get(f"{address}/api/objects?color=red&min_size=5cm&recording=kit*"))
    assert [(one["recording"], one["label"]) for one in found["objects"]] == [("kitchen", 1)]
    described = json.loads(get(f"{address}/openapi.json"))
    assert set(described["paths"]) == {
        *("/api/objects", "/api/objects/{recording}/{label}/picture", "/api/ask", "/api/last-seen"),
        *("/api/recordings", "/api/failures"),
    }
    assert json.loads(get(f"{address}/api/recordings"))["recordings"][0]["objects"] == 2
    put_run(StoreFolder(store), 2, [thing(7, color="red")], recording="office")  # while it is served
    found = json.loads(get(f"{address}/api/objects?like=kitchen%231&limit=1"))
    assert [(one["recording"], one["label"]) for one in found["objects"]] == [("office", 7)]


def test_the_pages(address: str) -> None:
    assert 'href="results/kitchen/00000000000000000001/report.html#1"' in get(f"{address}/").decode()
    assert 'href="results/kitchen/00000000000000000001/report.html"' in get(f"{address}/recordings").decode()
    assert b"a run" in get(f"{address}/results/kitchen/00000000000000000001/report.html")
    assert b"#1" in get(f"{address}/?color=red")


@pytest.mark.parametrize(
    "path",
    [
        "results/kitchen/00000000000000000001/secret.txt",
        "results/kitchen/../../runs/report.html",
        "results/%2e%2e/%2e%2e/run.json",
        "runs/",
        "_manifests/000000001.json",
    ],
)
def test_nothing_else_of_the_disk_is_given(address: str, path: str) -> None:
    assert refused(f"{address}/{path}")[0] == 404


def test_what_is_wrong_is_one_line(address: str) -> None:
    for question, said in (
        ("color=mauve", "unknown color"),
        ("near=1,2", "expected X,Y,Z"),
        ("size=3", "unknown parameter 'size'"),
        ("limit=many", "limit: expected a whole number from 0, got 'many'"),
        ("limit=-1", "limit: expected a whole number from 0, got '-1'"),
        ("since=9999-12-31T23:59:59-23:59", "since: expected 2026-03-01"),
        ("like=kitchen%2399", "has no object 99"),
    ):
        code, content = refused(f"{address}/api/objects?{question}")
        assert code == 400
        assert said in json.loads(content)["error"]


def test_it_is_read_only_and_answers_to_its_own_name(address: str) -> None:
    assert refused(f"{address}/api/objects", method="POST")[0] == 405
    assert refused(f"{address}/", Host="evil.example")[0] == 400


def test_a_body_is_refused_before_it_is_read(address: str) -> None:
    refuses_large_bodies(f"{address}/api/objects")


def test_where_others_can_reach_it_a_token_is_needed(store: str) -> None:
    with served(store, "--host", "0.0.0.0") as where:
        address, _, secret = where.partition("/?token=")
        address = address.replace("0.0.0.0", "127.0.0.1")
        assert len(secret) >= 20
        assert refused(f"{address}/")[0] == 401
        assert refused(f"{address}/api/objects", Authorization="Bearer wrong")[0] == 401
        assert b'"objects"' in get(f"{address}/api/objects", Authorization=f"Bearer {secret}")
        assert b"Recordings" in get(f"{address}/", Cookie=f"cuboid-token={secret}")
