"""The endpoints of a place: one table, of which routes, their documentation and the checks of parameters are made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from cuboid.ground.core.errors import InputError
from cuboid.results.files.ply import cloud_ply
from cuboid.services.queries.answers import About, Answer, FoundObject, FreePlace, History, MapChange, Surface, TreeNode
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.parameters import PARAMETERS, QUESTION, TEXT, Parameter, filters_of
from cuboid.services.queries.place import FREE_HEIGHT_M, ONLY_IN_A_STORE, SIGHTINGS, Place
from cuboid.services.queries.words import count, length, whole

T = TypeVar("T")
JSON = "application/json"
MESHES = {"glb": "model/gltf-binary", "obj": "model/obj", "ply": "application/octet-stream", "stl": "model/stl"}
FILTERS = tuple(name for name in PARAMETERS if name not in ONLY_IN_A_STORE)
Asked = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Endpoint:
    """An address of a place.

    Attributes
    ----------
    path : str
        With the parts that differ in braces.
    what : str
        What it answers.
    answer : callable
        (place, parameters by name) -> the answer; None if there is none.
    kind : type or str
        Type of the answer; or, where it is no JSON, its media type.
    parameters : dict of str to Parameter
        Of the query.
    """

    path: str
    what: str
    answer: Callable[[Place, Asked], Any]
    kind: Any
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    @property
    def media(self) -> str:
        """The media type of the answer."""
        return self.kind if isinstance(self.kind, str) else JSON


def _query(kind: str, meaning: str, **more: Any) -> Parameter:
    return Parameter({"type": kind, **more}, meaning, "")


def _read(asked: Asked, name: str, reader: Callable[[str], T], otherwise: T) -> T:
    try:
        return reader(asked[name]) if asked.get(name, "").strip() else otherwise
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None


def _label(asked: Asked) -> int:
    return _read(asked, "label", whole, 0)


def _flag(asked: Asked, name: str) -> bool:
    return asked.get(name, "").lower() in ("1", "true", "yes")


def filters_in(place: Place, asked: Asked) -> Filters:
    """Return the conditions of a request.

    Raises
    ------
    InputError
        A parameter is unknown or invalid, or it is for stores only.
    """
    unknown = [name for name in asked if name not in FILTERS]
    if unknown:
        raise InputError(f"unknown parameter '{unknown[0]}'; there are {', '.join(FILTERS)}")
    values = {name: value.strip() for name, value in asked.items() if value.strip()}
    text = place.text_query(values.pop(TEXT, None))
    return replace(filters_of(values), text=text)


def _ask(place: Place, asked: Asked) -> Answer:
    question = _needed(asked, "q")
    also = filters_in(place, {name: value for name, value in asked.items() if name != "q"})
    return place.ask(question, also.limit, also)


def _free(place: Place, asked: Asked) -> FreePlace | None:
    length_m, width_m = (_read(asked, name, length, 0.0) for name in ("length", "width"))
    height_m = _read(asked, "height", length, FREE_HEIGHT_M)
    return place.free_place(f"plane:{asked['number']}", length_m, width_m, height_m, asked.get("near") or None)


def _mesh(place: Place, asked: Asked) -> tuple[bytes, str]:
    form = asked.get("form") or "glb"
    if form not in MESHES:
        raise InputError(f"form: expected one of {', '.join(MESHES)}, got '{form}'")
    mesh = place.mesh(_label(asked), close=_flag(asked, "close"), complete=_flag(asked, "complete"))
    if not len(mesh.faces):
        raise InputError(f"object {mesh.label} has no mesh: no view shows enough of it")
    content = mesh.to_trimesh().export(file_type=form)
    return content.encode() if isinstance(content, str) else content, MESHES[form]


def _cloud(place: Place, asked: Asked) -> bytes:
    cloud = place.cloud(_label(asked))
    return cloud_ply(cloud.xyz, cloud.rgb)


_CONDITIONS = {name: PARAMETERS[name] for name in FILTERS}
_CLOSE = {
    "form": _query("string", "form of the file", enum=list(MESHES), default="glb"),
    "close": _query("boolean", "extend the walls down to the support, and close the bottom"),
    "complete": _query("boolean", "close all holes"),
}
_SIDES = {
    "length": _query("string", "length of the footprint", example="20cm"),
    "width": _query("string", "width of the footprint", example="15cm"),
    "height": _query("string", "height of the free space above the footprint", default=f"{FREE_HEIGHT_M:g}m"),
    "near": _query("string", "near a point X,Y,Z, or near an object, by label or name", example="mug"),
}

ENDPOINTS = (
    Endpoint("/api", "Title, number of objects, and state of the place", lambda place, _: place.about(), About),
    Endpoint(
        "/api/objects",
        "Objects, with the conditions of cuboid find",
        lambda place, asked: place.find(filters_in(place, asked)),
        list[FoundObject],
        _CONDITIONS,
    ),
    Endpoint("/api/objects/{label}", "An object and its relations", lambda p, q: p.object(_label(q)), FoundObject),
    Endpoint(
        "/api/objects/{label}/history",
        "Sightings of an object, and its relations over the recordings of a scene",
        lambda place, asked: place.history(_label(asked), _read(asked, "limit", count, SIGHTINGS)),
        History,
        {
            "limit": _query(
                "integer", "maximum number of sightings, at equal steps from the first to the last", default=SIGHTINGS
            )
        },
    ),
    Endpoint(
        "/api/objects/{label}/picture",
        "Its best picture",
        lambda place, asked: place.picture(_label(asked), last=_flag(asked, "last")),
        "image/jpeg",
        {"last": _query("boolean", "the picture of its last sighting instead")},
    ),
    Endpoint("/api/objects/{label}/cloud", "Its points, as PLY", _cloud, "application/octet-stream"),
    Endpoint("/api/objects/{label}/mesh", "Its surface", _mesh, MESHES["glb"], _CLOSE),
    Endpoint(
        "/api/last-seen",
        "The last sighting of the objects with a label or name, also of objects that are gone",
        lambda place, asked: place.last_seen(_needed(asked, "what")),
        list[FoundObject],
        {"what": _query("string", "label or name", example="mug")},
    ),
    Endpoint(
        "/api/ask",
        "The answer to a question in English, with the conditions that were understood, and further conditions",
        _ask,
        Answer,
        {"q": QUESTION, **_CONDITIONS},
    ),
    Endpoint("/api/surfaces", "The supporting planes", lambda place, _: place.surfaces(), list[Surface]),
    Endpoint("/api/surfaces/{number}/free", "The nearest free place on a surface", _free, FreePlace, _SIDES),
    Endpoint(
        "/api/tree",
        "The tree of the place: surfaces, the objects on them, and the objects on and in those",
        lambda p, _: p.tree(),
        list[TreeNode],
    ),
    Endpoint(
        "/api/changes",
        "The latest changes of the map",
        lambda place, asked: place.changes.after(_read(asked, "after", whole, 0)),
        list[MapChange],
        {"after": _query("integer", "changes after this number", default=0)},
    ),
)


def _needed(asked: Asked, name: str) -> str:
    value = asked.get(name, "").strip()
    if not value:
        raise InputError(f"{name} is needed")
    return value
