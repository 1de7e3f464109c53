"""True changes between made visits of one place: `visits.json`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cuboid.core.values import Count, Entry, Label, Name, Point, Side, refuse_twice


class ChangeOfThing(Entry, frozen=True):
    """The true change of an object between the visit before and this one."""

    id: Annotated[Label, Meta(description="the same in the truth of all visits")]
    change: Literal["unchanged", "moved", "gone", "new"]
    judged: Annotated[bool, Meta(description="false: finding it counts neither way")]
    metres: Annotated[Side, Meta(description="how far it was moved, metres")]
    empty_frames: Annotated[Count, Meta(description="frames that show the place where it stood")]
    seen_frames: Annotated[Count, Meta(description="frames that show it where it stands")]
    name: Annotated[Name | None, Meta(description="for people")] = None
    begun_at: Annotated[Point | None, Meta(description="where it stood, metres")] = msgspec.field(
        default=None, name="from"
    )
    to: Annotated[Point | None, Meta(description="where it stands, metres")] = None


class VisitEntry(Entry, frozen=True):
    """A visit."""

    recording: Annotated[Name, Meta(description="name of its folder, beside the file", pattern=r"^[^/\\\x00]+$")]
    changes: Annotated[list[ChangeOfThing], Meta(description="since the visit before; none in the first")]

    def __post_init__(self) -> None:
        refuse_twice("id", [one.id for one in self.changes])
        if self.recording in (".", ".."):
            raise ValueError("expected the name of a folder")


class VisitsDocument(Entry, frozen=True):
    """Visits of one place, and what changed between them: `visits.json`, from `cuboid synth --visits`."""

    format: Literal["cuboid-visits"]
    version: Literal[1]
    visits: Annotated[list[VisitEntry], Meta(description="in order of time")]
    name: Annotated[Name | None, Meta(description="for people")] = None
