"""Commands to a running node, and their answers; they are the same on every transport."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from cuboid.ground.core.errors import CuboidError
from cuboid.ground.core.results import TrackedObject
from cuboid.results.files.queries import PointCloud
from cuboid.services.ros2.parameters import Parameters
from cuboid.services.ros2.session import Session


class Command(msgspec.Struct, tag_field="command", forbid_unknown_fields=True, kw_only=True):
    """A command; the answer repeats its `id`."""

    id: int | str | None = None


class Save(Command, tag="save"):
    """Write the results so far."""

    folder: str = ""


class Reset(Command, tag="reset"):
    """Delete the map and start again."""


class Name(Command, tag="name"):
    """Set the name of an object; an empty name removes it."""

    label: int
    name: str


class Query(Command, tag="query"):
    """Find objects by label, part of the name, or distance from a point `near`, metres; 0 and "" match all objects."""

    label: int = 0
    name: str = ""
    near: tuple[float, float, float] = (0.0, 0.0, 0.0)
    within_m: float = 0.0


class Cloud(Command, tag="cloud"):
    """Return the points of an object; label 0: of the whole map."""

    label: int = 0


class Set(Command, tag="set"):
    """Change a parameter."""

    parameter: str
    value: bool | int | float | str


class ListParameters(Command, tag="parameters"):
    """Return the parameters and their values."""


AnyCommand = Save | Reset | Name | Query | Cloud | Set | ListParameters


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a command.

    Attributes
    ----------
    success : bool
    message : str
        The result, or the reason for the failure.
    objects : tuple of TrackedObject or None
        The objects that a query found.
    cloud : PointCloud or None
    parameters : dict or None
    """

    success: bool
    message: str
    objects: tuple[TrackedObject, ...] | None = None
    cloud: PointCloud | None = None
    parameters: dict[str, Any] | None = None


def answer(command: AnyCommand, session: Session, parameters: Parameters) -> Answer:
    """Execute a command and return its answer; an invalid command has an answer without success."""
    try:
        return _done(command, session, parameters)
    except CuboidError as error:
        return Answer(False, str(error))


def _done(command: AnyCommand, session: Session, parameters: Parameters) -> Answer:
    match command:
        case Save():
            return Answer(True, f"saved in {session.save(command.folder)}")
        case Reset():
            session.reset()
            return Answer(True, "the map is empty")
        case Name():
            item = session.name(command.label, command.name)
            return Answer(True, f"#{item.label} is called '{command.name}'" if command.name else f"#{item.label}")
        case Query():
            found = session.query(command.label, command.name, command.near, command.within_m)
            return Answer(True, f"{len(found)} objects", tuple(found))
        case Cloud():
            cloud = session.cloud(command.label)
            return Answer(True, f"{len(cloud)} points", cloud=cloud)
        case Set():
            parameters.set(command.parameter, command.value)
        case ListParameters():
            pass
    return Answer(True, "", parameters=parameters.values)
