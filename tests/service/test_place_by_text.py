"""Objects of results and of a scene ranked by a text: by `cuboid find`, over HTTP, and by assistants."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import urlopen

import pytest

pytest.importorskip("tokenizers")

from mcp.client.client import Client

from cuboid import cli
from cuboid.method.text_search import Embeddings, TextModel
from cuboid.runs.scene import Scene
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.opening import open_place
from cuboid.services.service.mcp import server_of
from made_place import write_place
from served import served

COLORS = {1: "red", 2: "blue", 4: "red", 5: "green"}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, model: Path) -> Path:
    """Results with vectors of four of the five objects: each is that of a color."""
    folder, opened = write_place(tmp_path_factory.mktemp("place")), TextModel(model)
    vectors = {label: opened.query(color).vector for label, color in COLORS.items()}
    (folder / "embeddings.npz").write_bytes(Embeddings(opened.identity, vectors).content())
    return folder


def asked(address: str, **question: str) -> Any:
    with urlopen(f"{address}/api/objects?{urlencode(question)}", timeout=30) as answer:
        return json.load(answer)


def test_a_server_ranks_the_objects_that_the_other_filters_let_pass(results: Path, model: Path) -> None:
    with served(str(results), "--text-model", str(model)) as address:
        found = asked(address, text="a red mug")
        assert [one["label"] for one in found][:2] == [1, 4]
        assert {one["label"] for one in found} == set(COLORS), "an object without a vector has no rank"
        assert [one["text_score"] for one in found] == sorted((one["text_score"] for one in found), reverse=True)
        assert [one["label"] for one in asked(address, text="red", limit="1")] == [1]
        assert [one["label"] for one in asked(address, text="red", max_size="10cm")] == [5]
        near = asked(address, text="blue", near_object="crate", within="1m")
        assert (near[0]["label"], near[0]["distance_m"]) == (2, pytest.approx(0.0, abs=0.1))
        assert asked(address, name="mug")[0]["text_score"] is None


def test_without_a_model_one_line_says_how_to_give_one(results: Path) -> None:
    with served(str(results)) as address:
        with pytest.raises(HTTPError) as error:
            asked(address, text="red")
        with error.value as answer:
            assert answer.code == 400
            assert "this server has no image-text model" in json.load(answer)["error"]


def test_assistants_ask_by_a_text(results: Path, model: Path) -> None:
    async def ask(server: Any) -> Any:
        async with Client(server) as client:
            return await client.call_tool("find_objects", {"text": "green", "limit": 1})

    found = asyncio.run(ask(server_of(open_place(str(results), TextModel(model)))))
    assert [one["label"] for one in found.structured_content["result"]] == [5]
    refused = asyncio.run(ask(server_of(open_place(str(results)))))
    assert refused.is_error
    assert "--text-model DIR" in refused.content[0].text


def test_find_takes_a_text_with_other_conditions(
    results: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["find", str(results), "--text", "red", "--text-model", str(model)]
    assert cli.main([*words, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["objects"]
    assert [row["label"] for row in rows][:2] == [1, 4]
    assert cli.main([*words, "--in", "crate"]) == 0
    shown = capsys.readouterr().out
    assert "#2 can" in shown
    assert "#5" not in shown


def test_while_a_scene_is_asked_others_can_write_it(tmp_path: Path, model: Path) -> None:
    pictured, opened = scene_with_pictures(tmp_path), TextModel(model)
    place = open_place(str(pictured), opened)
    found = place.find(Filters(text=opened.query("green")))
    with Scene.open(pictured) as scene:
        expected = [(item.label, score) for item, score in scene.find("green", opened)]
    assert [one.label for one in found] == [label for label, _ in expected]
    assert [one.text_score for one in found] == [pytest.approx(score, abs=1e-5) for _, score in expected]
    with Scene.open(pictured) as scene:
        scene.name(found[0].label, "plant")  # refused while another one has the scene open to write


def scene_with_pictures(folder: Path) -> Path:
    size = ("--frames", "24", "--size", "160x120", "--sensor", "clean", "--workers", "1")
    assert cli.main(["synth", *size, "--output", str(folder / "table")]) == 0
    words = ["track", str(folder / "table"), "--output", str(folder / "results")]
    assert cli.main([*words, "--scene", str(folder / "made.cuboid")]) == 0
    return folder / "made.cuboid"
