"""A store for assistants: tools of the Model Context Protocol that search the objects of all recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeVar

from mcp.server.mcpserver import Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from cuboid.fleet.store.find import ask as ask_store
from cuboid.fleet.store.find import find, picture_of
from cuboid.fleet.store.find import last_seen as last_seen_in
from cuboid.fleet.store.query import SharedTables, Tables
from cuboid.fleet.store.summary import summarise_store
from cuboid.ground.core.errors import InputError
from cuboid.ground.version import __version__
from cuboid.method.text_search import TextModel
from cuboid.services.queries.parameters import text_query
from cuboid.services.queries.rows import CENTER, SIDES, sigma_names
from cuboid.services.queries.words import moment, thing
from cuboid.services.service.mcp import (
    READ_ONLY,
    Conditions,
    Label,
    Last,
    Limit,
    Question,
    What,
    add_find_objects,
    answered,
)

T = TypeVar("T")
INSTRUCTIONS = (
    "Recordings of an RGB-D camera, and the objects that were found in each: boxes, names, colors, pictures. "
    "Lengths are metres, in the world of each recording; times are UTC. Begin with describe_store."
)

CAMERA = ("camera_x_m", "camera_y_m", "camera_z_m")
Recording = Annotated[str, Field(description="name of a recording")]


@dataclass(frozen=True)
class StoreRecording:
    """A recording that was tracked."""

    recording: str
    objects: int
    frames_read: int
    frames_used: int
    warnings: int


@dataclass(frozen=True)
class StoreAbout:
    """The size of a store."""

    recordings: int
    objects: int
    frames: int
    not_done: int


@dataclass(frozen=True)
class StoredObject:
    """An object of a recording; camera and later are of its last frame, and of the frames after it."""

    recording: str
    label: int
    name: str | None
    state: str
    color: str | None
    colors: list[str]
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    score: float | None
    probability: float | None
    frames_seen: int
    last_seen: str | None
    last_frame: int | None = None
    camera_m: tuple[float, float, float] | None = None
    camera_distance_m: float | None = None
    later: str | None = None
    later_frame: int | None = None
    size_sigma_m: tuple[float, float, float] | None = None
    center_sigma_m: tuple[float, float, float] | None = None
    sides_seen: list[str] | None = None
    distance_m: float | None = None
    unlike: float | None = None
    text_score: float | None = None


@dataclass(frozen=True)
class StoredAnswer:
    """The answer to a question in English: its conditions in words, the objects, and why there are none."""

    understood: tuple[str, ...]
    objects: list[StoredObject]
    note: str | None


@dataclass(frozen=True)
class StoreConditions(Conditions):
    """The parameters of `find_objects` for a store."""

    recording: Annotated[str | None, Field(description="glob of names of recordings")] = None
    since: Annotated[str | None, Field(description="date or time (UTC), or 7d, 12h, 30min")] = None
    like: Annotated[str | None, Field(description="RECORDING#LABEL: the most similar objects first")] = None


def server_of(url: str, model: TextModel | None = None) -> MCPServer:
    """Return the MCP server of a store.

    Parameters
    ----------
    url : str
    model : TextModel, optional
        Model for text search, which ranks the objects.

    Raises
    ------
    InputError
        There is no store at the URL.
    """
    server = MCPServer("cuboid", version=__version__, instructions=INSTRUCTIONS, log_level="WARNING")
    tables = SharedTables(url)

    async def asked(question: Callable[[Tables], T]) -> T:
        return await answered(tables.ask, question)

    @server.tool(annotations=READ_ONLY)
    async def describe_store() -> StoreAbout:
        """Tell how many recordings, objects and frames the store has, and how many recordings are not done."""
        found = await asked(lambda of: summarise_store(of, 1))
        totals, not_done = found.totals, sum(one["count"] for one in found.failed)
        return StoreAbout(totals["recordings"], totals["objects"], totals["frames"], not_done)

    @server.tool(annotations=READ_ONLY)
    async def list_recordings(
        recording: Annotated[str | None, Field(description="glob of their names, such as kitchen*")] = None,
        limit: Limit = 50,
    ) -> list[StoreRecording]:
        """List recordings that are done, those with the worst quality first."""
        found = await asked(lambda of: summarise_store(of, limit, recording))
        return [_recording(row) for row in found.worst]

    def found(asked: StoreConditions) -> list[StoredObject]:
        """Find objects in all recordings by name, size, color, place, time and relations; all must hold.

        With `like`, the most similar objects are first; with a text, those whose pictures fit it best.
        """

        def answer(of: Tables) -> list[StoredObject]:
            read = {"since": _read(moment, asked.since), "like": _read(thing, asked.like)}
            return [_object(row) for row in find(of, asked.filters(text_query(asked.text, model), **read))]

        return tables.ask(answer)

    add_find_objects(server, StoreConditions, list[StoredObject], found)

    @server.tool(annotations=READ_ONLY)
    async def ask(question: Question, limit: Limit = 10) -> StoredAnswer:
        """Answer a question in plain English by a small grammar, and tell which conditions were understood."""
        understood, rows, note = await asked(lambda of: ask_store(of, question, limit=limit))
        return StoredAnswer(understood, [_object(row) for row in rows], note)

    @server.tool(annotations=READ_ONLY)
    async def last_seen(what: What) -> list[StoredObject]:
        """Tell where and when an object was seen last, from where, and whether it is still there; the latest first."""
        return [_object(row) for row in await asked(lambda of: last_seen_in(of, what))]

    @server.tool(annotations=READ_ONLY)
    async def picture_of_object(recording: Recording, label: Label, last: Last = False) -> Image:
        """Show the best picture of an object, or that of its last sighting."""
        picture = await asked(lambda of: picture_of(of, recording, label, last=last))
        if picture is None:
            raise ToolError(f"there is no picture of object {label} of {recording}")
        return Image(data=picture, format="jpeg")

    return server


def _read(read: Callable[[str], T], text: str | None) -> T | None:
    try:
        return None if text is None else read(text)
    except ValueError as error:
        raise InputError(str(error)) from None


def _recording(row: dict[str, Any]) -> StoreRecording:
    counts = {name: row[name] or 0 for name in ("objects", "frames_read", "frames_used", "warnings")}
    return StoreRecording(row["recording"], **counts)


def _object(row: dict[str, Any]) -> StoredObject:
    x, y, z = (round(row[f"center_{axis}_m"], 4) for axis in "xyz")
    size = tuple(round(row[side], 4) for side in SIDES)
    seen = row["last_seen"]
    values = {one.name: row[one.name] for one in fields(StoredObject) if one.name in row}
    values |= {name: round(row[name], 4) for name in ("distance_m", "unlike", "text_score") if name in row}
    values |= {"center_m": (x, y, z), "size_m": size, "camera_m": _three(row, CAMERA)}
    values |= {"size_sigma_m": _three(row, sigma_names(SIDES)), "center_sigma_m": _three(row, sigma_names(CENTER))}
    return StoredObject(**{**values, "last_seen": None if seen is None else seen.isoformat()})


def _three(row: dict[str, Any], names: Sequence[str]) -> tuple[float, ...] | None:
    values = tuple(row[name] for name in names)
    return None if None in values else tuple(round(value, 4) for value in values)
