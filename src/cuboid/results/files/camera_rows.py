"""The rows of one camera of a rig, with the frame numbers of its own recording."""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from cuboid.results.files.report import RunReport
from cuboid.results.files.rows import AgentRow, EventRow, PoseRow, ProposalRow, TrackRow

R = TypeVar("R", TrackRow, ProposalRow, AgentRow)


@dataclass(frozen=True, slots=True)
class CameraRows:
    """Selects the rows of one camera of a rig and numbers them as its own recording does.

    Attributes
    ----------
    number : int
        Number of the camera in the rig.
    own : mapping of int to int
        The number of each frame of the camera in its own recording, by its number in the rig, ascending.
    """

    number: int
    own: Mapping[int, int]

    def rows(self, rows: Iterable[R]) -> list[R]:
        """Return the rows in the frames of the camera."""
        return [replace(row, frame=self.own[row.frame]) for row in rows if row.frame in self.own]

    def poses(self, poses: Mapping[int, PoseRow]) -> dict[int, PoseRow]:
        """Return pose and time of each used frame of the camera."""
        return {self.own[frame]: row for frame, row in poses.items() if frame in self.own}

    def events(self, events: Sequence[EventRow], used: Iterable[int]) -> list[EventRow]:
        """Return the events of a rig with `used` frames, each at the camera's next used frame, else at its last one."""
        frames = [frame for frame in used if frame in self.own]
        if not frames:
            return []
        at = [min(bisect.bisect_left(frames, row.frame), len(frames) - 1) for row in events]
        return [replace(row, frame=self.own[frames[k]]) for row, k in zip(events, at, strict=True)]

    def report(self, report: RunReport, used: int) -> RunReport:
        """Return the report of a run, with the recording and the frames of the camera, `used` of which were used."""
        skipped = tuple((self.own[frame], reason) for frame, reason in report.skipped if frame in self.own)
        return replace(
            report,
            recording=report.rig_recordings[self.number] if report.rig_recordings else report.recording,
            config={key: value for key, value in report.config.items() if key != "rig"},
            frames_read=used + len(skipped),
            frames_used=used,
            skipped=skipped,
        )
