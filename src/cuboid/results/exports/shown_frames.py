"""The frames of a run as the exports for viewers show them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

from cuboid.ground.formats.stored import is_there
from cuboid.results.files import Results, TrackRow
from cuboid.results.files.rows import PoseRow


class ShownFrame(NamedTuple):
    """A used frame, with its sightings, and the labels that ended (merged, retired) in the frame before."""

    frame: int
    pose: PoseRow
    seen: list[TrackRow]
    gone: list[int]


def shown_frames(run: Results) -> Iterator[ShownFrame]:
    """Iterate over the used frames, in order."""
    seen: dict[int, list[TrackRow]] = defaultdict(list)
    last_seen: dict[int, int] = {}
    for row in run.tracks:
        seen[row.frame].append(row)
        last_seen[row.label] = row.frame
    lasting = {item.label for item in run.found.objects}
    gone: list[int] = []
    for frame, pose in run.poses.items():
        yield ShownFrame(frame, pose, seen[frame], gone)
        gone = [row.label for row in seen[frame] if row.label not in lasting and last_seen[row.label] == frame]


def missing_pictures(run: Results) -> list[str]:
    """Return a note if the recording with the pictures is missing; raise InputError if it is a wrong one."""
    if run.recording_path is None and not is_there(run.report.recording):
        return [f"{run.report.recording} is not there: no pictures (--recording says where it is)"]
    _ = run.recording
    return []
