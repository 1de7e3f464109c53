"""A place for assistants, asked by the client of the MCP SDK."""

from __future__ import annotations

import asyncio
import base64
import json
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import msgspec
import pytest
from mcp.client.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

from cuboid.cli import main
from cuboid.services.queries.opening import open_place
from made_place import write_place
from served import refuses_large_bodies, served


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_place(tmp_path_factory.mktemp("mcp"))


def ask(target: Any, questions: Callable[[Client], Awaitable[None]]) -> None:
    async def asking() -> None:
        async with Client(target) as client:
            await questions(client)

    asyncio.run(asking())


async def all_tools(client: Client, results: Path) -> None:
    """Ask each tool, and hold its answers against those of the place."""
    place = open_place(str(results))
    tools = {tool.name: tool for tool in (await client.list_tools()).tools}
    assert set(tools) == {
        "describe_place",
        "find_objects",
        "ask",
        "last_seen",
        "recent_changes",
        "describe_object",
        "picture_of_object",
        "history_of_object",
        "free_place",
    }
    typed = set(tools) - {"picture_of_object"}
    assert all(tools[name].output_schema for name in typed)
    assert all(tool.description and tool.annotations.read_only_hint for tool in tools.values())

    async def call(name: str, **values: Any) -> Any:
        answer = await client.call_tool(name, values)
        assert not answer.is_error, answer.content
        return answer.structured_content

    described = await call("describe_place")
    assert described["about"]["objects"] == 5
    assert [one["height_m"] for one in described["surfaces"]] == [0.0, 0.5]
    assert [child["name"] for child in described["tree"][0]["children"]] == ["crate", None]
    (can,) = (await call("find_objects", inside="crate"))["result"]
    assert (can["label"], can["name"], can["relations"][0]["kind"]) == (2, "can", "in")
    assert [one["label"] for one in (await call("find_objects", color="red", max_size_m=0.2))["result"]] == [5]
    likely = (await call("find_objects", min_probability=0.8))["result"]
    assert [(one["label"], one["probability"]) for one in likely] == [(k, 0.9) for k in (1, 2, 3, 5)]
    assert await call("describe_object", label=5) == json.loads(msgspec.json.encode(place.object(5)))
    assert (await call("last_seen", what="mug"))["result"][0]["last_seen"]["frame"] == 5
    assert (await call("history_of_object", label=4, limit=2))["count"] == 3
    assert (await call("recent_changes"))["result"] == []
    free = (await call("free_place", surface="plane:1", length_m=0.2, width_m=0.1, near="crate"))["result"]
    assert free["distance_m"] == pytest.approx(0.19, abs=0.03)
    assert (await call("free_place", surface="plane:1", length_m=3.0, width_m=3.0))["result"] is None
    (picture,) = (await client.call_tool("picture_of_object", {"label": 1})).content
    assert (picture.type, picture.mime_type) == ("image", "image/jpeg")
    assert base64.b64decode(picture.data)[:2] == b"\xff\xd8"


async def wrong_questions(client: Client) -> None:
    for name, values, said in (
        ("describe_object", {"label": 99}, "no object has the label 99"),
        ("find_objects", {"on": "lamp"}, "the name 'lamp'"),
        ("find_objects", {"color": "mauve"}, "unknown color 'mauve'"),
        ("free_place", {"surface": "table", "length_m": 0.1, "width_m": 0.1}, "plane:0 to plane:1"),
        ("free_place", {"surface": "plane:1", "length_m": -0.1, "width_m": 0.1}, "greater than 0"),
    ):
        answer = await client.call_tool(name, values)
        assert answer.is_error
        assert said in answer.content[0].text


def test_over_standard_input_and_output(results: Path) -> None:
    async def questions(client: Client) -> None:
        await all_tools(client, results)
        await wrong_questions(client)

    command = StdioServerParameters(command=sys.executable, args=["-m", "cuboid", "mcp", str(results)])
    ask(stdio_client(command), questions)


def test_over_http(results: Path) -> None:
    with served(str(results), "--http", command="mcp") as address:
        ask(address, lambda client: all_tools(client, results))
        with pytest.raises(HTTPError) as error:
            urlopen(Request(address, b"{}", {"Content-Type": "application/json", "Origin": "http://evil.example"}))
        assert error.value.code == 403
        error.value.close()
        refuses_large_bodies(address)


def test_where_others_can_reach_it_a_token_is_needed(results: Path) -> None:
    with served(str(results), "--http", "--host", "0.0.0.0", "--token", "secret", command="mcp") as where:
        address, _, _ = where.replace("0.0.0.0", "127.0.0.1").partition("?")
        with pytest.raises(HTTPError) as error:
            urlopen(Request(address, b"{}", {"Content-Type": "application/json"}))
        assert error.value.code == 401
        error.value.close()


def test_a_folder_that_is_no_place_and_no_store_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mcp", str(tmp_path)]) == 2
    assert "expected a store that 'cuboid batch' wrote" in capsys.readouterr().err
