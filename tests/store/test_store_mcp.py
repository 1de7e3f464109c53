"""A store for assistants, asked by the client of the MCP SDK."""

from __future__ import annotations

import asyncio
import base64
from typing import Any

import pytest
from made_stores import put_run, thing
from mcp.client.client import Client

from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.mcp import server_of
from cuboid.ground.core.errors import InputError
from served import served

JPEG = b"\xff\xd8\xff\xe0 a picture"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    place = StoreFolder(str(tmp_path_factory.mktemp("asked")))
    things = [thing(1, color="red", name="mug", picture=JPEG), thing(2, longest_m=0.4)]
    put_run(place, 1, things, recording="kitchen")
    put_run(place, 2, [thing(7, color="red", center_x_m=2.0)], recording="office")
    put_run(place, 3, [], recording="cellar", state="refused", reason="no depth")
    return place.url


async def questions(client: Client) -> None:
    tools = {tool.name: tool for tool in (await client.list_tools()).tools}
    assert set(tools) == {
        *("describe_store", "list_recordings", "find_objects", "ask", "last_seen", "picture_of_object")
    }
    assert all(tool.description and tool.annotations.read_only_hint for tool in tools.values())

    async def call(tool: str, /, **values: Any) -> Any:
        answer = await client.call_tool(tool, values)
        assert not answer.is_error, answer.content
        return answer.structured_content

    async def found(**values: Any) -> list[tuple[str, int]]:
        return [(one["recording"], one["label"]) for one in (await call("find_objects", **values))["result"]]

    described = await call("describe_store")
    assert described == {"recordings": 2, "objects": 3, "frames": 20, "not_done": 1}
    recordings = {one["recording"]: one["objects"] for one in (await call("list_recordings"))["result"]}
    assert recordings == {"kitchen": 2, "office": 1}
    assert await found(color="red", recording="k*") == [("kitchen", 1)]
    assert await found(name="mug") == [("kitchen", 1)]
    assert await found(min_size_m=0.3) == [("kitchen", 2)]
    assert await found(near=(2.0, 0.0, 0.1), within_m=0.2) == [("office", 7)]
    assert (await found(like="kitchen#1", limit=1)) == [("office", 7)]
    assert await found(since="2031-01-01") == []
    (one,) = (await call("find_objects", name="mug"))["result"]
    assert (one["center_m"], one["size_m"], one["last_seen"][:10]) == ([0.0, 0.0, 0.0], [0.1, 0.1, 0.1], "2026-03-01")
    (picture,) = (await client.call_tool("picture_of_object", {"recording": "kitchen", "label": 1})).content
    assert (picture.mime_type, base64.b64decode(picture.data)) == ("image/jpeg", JPEG)
    for name, values, said in (
        ("find_objects", {"color": "mauve"}, "unknown color 'mauve'"),
        ("find_objects", {"since": "yesterday"}, "expected 2026-03-01"),
        ("find_objects", {"like": "attic#1"}, "attic#1: there is no recording 'attic'"),
        ("find_objects", {"text": "cup"}, "no image-text model"),
        ("picture_of_object", {"recording": "kitchen", "label": 2}, "there is no picture of object 2 of kitchen"),
        ("picture_of_object", {"recording": "kitchen", "label": 9}, "has no object 9"),
    ):
        answer = await client.call_tool(name, values)
        assert answer.is_error
        assert said in answer.content[0].text


def test_an_assistant_searches_the_objects_of_all_recordings(store: str) -> None:
    async def asking(target: Any) -> None:
        async with Client(target) as client:
            await questions(client)

    asyncio.run(asking(server_of(store)))
    with served(store, "--http", command="mcp") as address:
        asyncio.run(asking(address))


def test_a_folder_that_is_no_store_is_refused(tmp_path: Any) -> None:
    with pytest.raises(InputError, match="expected a store that 'cuboid batch' wrote"):
        server_of(str(tmp_path))
