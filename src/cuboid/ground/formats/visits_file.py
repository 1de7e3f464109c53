"""True changes between made visits of one place: `visits.json`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cuboid.ground.core.values import Count, Entry, Label, Name, Point, Side, refuse_twice


class ChangeOfThing(Entry, frozen=True):
    """The true change of an object between the previous visit and this one."""

    id: Annotated[Label, Meta(description="identity of the object, the same in all visits")]
    change: Literal["unchanged", "moved", "gone", "new"]
    judged: Annotated[bool, Meta(description="false: results for it are not judged")]
    metres: Annotated[Side, Meta(description="distance of the move, metres")]
    empty_frames: Annotated[Count, Meta(description="number of frames that show its old place")]
    seen_frames: Annotated[Count, Meta(description="number of frames that show it at its new place")]
    name: Annotated[Name | None, Meta(description="name")] = None
    begun_at: Annotated[Point | None, Meta(description="centre of its box before, metres")] = msgspec.field(
        default=None, name="from"
    )
    to: Annotated[Point | None, Meta(description="centre of its box after, metres")] = None


class VisitEntry(Entry, frozen=True):
    """A visit."""

    recording: Annotated[
        Name, Meta(description="name of the folder of the recording, beside the file", pattern=r"^[^/\\\x00]+$")
    ]
    changes: Annotated[list[ChangeOfThing], Meta(description="changes since the previous visit; empty for the first")]

    def __post_init__(self) -> None:
        refuse_twice("id", [one.id for one in self.changes])
        if self.recording in (".", ".."):
            raise ValueError("expected the name of a folder")


class VisitsDocument(Entry, frozen=True):
    """Visits of one place, with the changes between them: `visits.json`, from `cuboid synth --visits`."""

    format: Literal["cuboid-visits"]
    version: Literal[1]
    visits: Annotated[list[VisitEntry], Meta(description="visits in the order of time")]
    name: Annotated[Name | None, Meta(description="name")] = None
