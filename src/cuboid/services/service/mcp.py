"""A place for assistants: tools of the Model Context Protocol with typed answers, and pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from inspect import Parameter, Signature, getdoc
from typing import Annotated, Any, TypeVar, get_type_hints

from mcp.server.mcpserver import Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.transport_security import TransportSecuritySettings
from mcp.types import ToolAnnotations
from pydantic import Field
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool

from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.ground.version import __version__
from cuboid.method.text_search import TextQuery
from cuboid.services.queries.answers import About, Answer, FoundObject, FreePlace, History, MapChange, Surface, TreeNode
from cuboid.services.queries.api import access
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.parameters import MAX_ROWS, MAX_SIZE_M
from cuboid.services.queries.place import FREE_HEIGHT_M, SIGHTINGS, Place

T = TypeVar("T")
C = TypeVar("C", bound="Conditions")
INSTRUCTIONS = (
    "A place seen by an RGB-D camera: objects with persistent labels and 3D boxes, and their relations. "
    "Lengths are metres, in the world of the place; times are UTC. Begin with describe_place."
)
TEXT = "description such as 'something to drink from'; the server needs --text-model"
# Methods of requests over HTTP.
METHODS = ("GET", "HEAD", "POST", "DELETE")
READ_ONLY = ToolAnnotations(read_only_hint=True, open_world_hint=False)

Label = Annotated[int, Field(ge=1, description="label of an object")]
Thing = Annotated[str | None, Field(description="label or name of an object")]
Question = Annotated[str, Field(description="such as 'the blue bin beside the chair', 'where is the red cup'")]
What = Annotated[str, Field(description="label or name")]
Last = Annotated[bool, Field(description="the picture of its last sighting")]
Limit = Annotated[int, Field(ge=1, le=MAX_ROWS)]
Length = Annotated[float, Field(gt=0.0, description="metres")]


@dataclass(frozen=True)
class Described:
    """What a place is, its surfaces, and the tree of what is on and in what."""

    about: About
    surfaces: list[Surface]
    tree: list[TreeNode]


@dataclass(frozen=True)
class Conditions:
    """The parameters of `find_objects`; the names are those of `Filters`, except the two sizes."""

    name: Annotated[str | None, Field(description="name, or likely class")] = None
    on: Annotated[str | None, Field(description="on an object by label or name, or on floor, table or plane:N")] = None
    inside: Thing = None
    beside: Thing = None
    near_object: Thing = None
    near: Annotated[tuple[float, float, float] | None, Field(description="a point in the world, metres")] = None
    within_m: Length = 0.5
    min_size_m: Annotated[float, Field(ge=0.0, description="minimum length of the longest side, metres")] = 0.0
    max_size_m: Annotated[float, Field(gt=0.0, description="maximum length of the longest side, metres")] = MAX_SIZE_M
    min_probability: Annotated[
        float | None, Field(ge=0.0, le=1.0, description="minimum probability that it is one whole object")
    ] = None
    color: Annotated[str | None, Field(description="one of the eleven basic color words")] = None
    text: Annotated[str | None, Field(description=TEXT)] = None
    limit: Limit = 10

    def filters(self, text: TextQuery | None, **read: object) -> Filters:
        """Return them as filters, with the text as `text_query` returns it and the values in `read` replaced."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        size_m = values.pop("min_size_m"), values.pop("max_size_m")
        return Filters(**{**values, **read, "size_m": size_m, "text": text})


def add_find_objects(server: MCPServer, kind: type[C], answer: object, find: Callable[[C], object]) -> None:
    """Add the tool `find_objects`: parameters are the fields of `kind`, the description is the docstring of `find`."""

    async def find_objects(**asked: Any) -> object:
        return await answered(find, kind(**asked))

    hints = get_type_hints(kind, include_extras=True)
    parameters = [
        Parameter(one.name, Parameter.KEYWORD_ONLY, default=one.default, annotation=hints[one.name])
        for one in fields(kind)
    ]
    vars(find_objects)["__signature__"] = Signature(parameters, return_annotation=answer)
    server.tool(annotations=READ_ONLY, description=getdoc(find))(find_objects)


async def answered(question: Callable[..., T], *values: object) -> T:
    """Answer in a thread; a fault of the query is one line for the assistant."""
    try:
        return await run_in_threadpool(question, *values)
    except (InputError, MissingExtraError) as error:
        raise ToolError(str(error)) from None


def server_of(place: Place) -> MCPServer:
    """Return the MCP server of a place."""
    server = MCPServer("cuboid", version=__version__, instructions=INSTRUCTIONS, log_level="WARNING")
    _add_finding(server, place)
    _add_objects(server, place)
    _add_surfaces(server, place)
    return server


def application(server: MCPServer, *, token: str | None, hosts: tuple[str, ...]) -> Starlette:
    """Return the server as an ASGI application (streamable HTTP), which answers at /mcp.

    Parameters
    ----------
    server : MCPServer
    token : str or None
        Token that a request must contain; with None every request is answered.
    hosts : tuple of str
        Names under which it is answered; ``*`` for any.
    """
    # Names and origins are checked here, as in the other servers.
    checked_here = TransportSecuritySettings(enable_dns_rebinding_protection=False)
    app = server.streamable_http_app(json_response=True, stateless_http=True, transport_security=checked_here)
    app.user_middleware += access(token, hosts, METHODS)
    return app


def _add_finding(server: MCPServer, place: Place) -> None:
    @server.tool(annotations=READ_ONLY)
    async def describe_place() -> Described:
        """Describe the place: surfaces with heights, and the tree of objects on and in each other."""

        def answer() -> Described:
            return Described(place.about(), place.surfaces(), list(place.tree()))

        return await answered(answer)

    def find(asked: Conditions) -> list[FoundObject]:
        """Find objects by name, size, color, nearness, and what they are on, in or beside; all must hold.

        With a text, they are ranked by how well their pictures fit it.
        """
        return place.find(asked.filters(place.text_query(asked.text)))

    add_find_objects(server, Conditions, list[FoundObject], find)

    @server.tool(annotations=READ_ONLY)
    async def ask(question: Question, limit: Limit = 10) -> Answer:
        """Answer a question in plain English by a small grammar, and tell which conditions were understood."""
        return await answered(place.ask, question, limit)

    @server.tool(annotations=READ_ONLY)
    async def last_seen(what: What) -> list[FoundObject]:
        """Tell where and when an object was seen last, from where, and whether it is still there; the latest first."""
        return await answered(place.last_seen, what)

    @server.tool(annotations=READ_ONLY)
    async def recent_changes(after: Annotated[int, Field(ge=0)] = 0) -> list[MapChange]:
        """List the changes since the server started, or after a number: confirmed, moved, renamed, merged, gone."""

        def answer() -> list[MapChange]:
            place.refresh()
            return place.changes.after(after)

        return await answered(answer)


def _add_objects(server: MCPServer, place: Place) -> None:
    @server.tool(annotations=READ_ONLY)
    async def describe_object(label: Label) -> FoundObject:
        """Describe one object: box, name, times, and its relations to other objects."""
        return await answered(place.object, label)

    @server.tool(annotations=READ_ONLY)
    async def picture_of_object(label: Label, last: Last = False) -> Image:
        """Show the best picture of an object, or that of its last sighting."""
        picture = await answered(partial(place.picture, last=last), label)
        if picture is None:
            raise ToolError(f"there is no picture of object {label}")
        return Image(data=picture, format="jpeg")

    @server.tool(annotations=READ_ONLY)
    async def history_of_object(label: Label, limit: Limit = SIGHTINGS) -> History:
        """Tell when and where an object was seen, and its relations over the recordings of a scene."""
        return await answered(place.history, label, limit)


def _add_surfaces(server: MCPServer, place: Place) -> None:
    @server.tool(annotations=READ_ONLY)
    async def free_place(
        surface: Annotated[str, Field(description="plane:N, of describe_place")],
        length_m: Length,
        width_m: Length,
        height_m: Length = FREE_HEIGHT_M,
        near: Annotated[str | None, Field(description="X,Y,Z in the world, or label or name of an object")] = None,
    ) -> FreePlace | None:
        """Find the nearest free place on a surface for an object with a given footprint and height."""
        return await answered(place.free_place, surface, length_m, width_m, height_m, near)
