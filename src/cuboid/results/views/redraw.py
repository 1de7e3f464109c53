"""Finished results drawn into the images of their recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.frame import Frame
from cuboid.ground.formats.folder import MAP
from cuboid.results.files import read_map
from cuboid.results.views.drawing import Status, draw_frame, draw_proposals
from cuboid.results.views.overlays import depth_picture, heat_over, map_heat, planes_over
from cuboid.results.views.replay import Replay, ReplayedFrame
from cuboid.results.views.tags import SteadyNames

Draw = Callable[[Frame, ReplayedFrame], UInt8Array]

# The kinds of pictures of a frame, and their names on the command line.
KINDS = {"boxes": "Picture", "heat": "Heat", "depth": "Depth", "proposals": "Proposals", "planes": "Planes"}


def drawer(kind: str, results: Path, replay: Replay, *, steady: SteadyNames | None = None) -> Draw:
    """Return a function that draws a frame and its results.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    results : Path
        The result folder.
    replay : Replay
        Of that folder.
    steady : SteadyNames, optional
        State of the names, if the frames of a video are drawn in order.
    """
    points = read_map(results / MAP) if kind == "heat" else None

    def background(frame: Frame, found: ReplayedFrame) -> UInt8Array:
        K = frame.intrinsics_or(replay.intrinsics)
        if points is not None:
            return heat_over(frame.color, map_heat(points, frame.depth_m, found.T_world_camera, K))
        if kind == "planes":
            return planes_over(frame.color, replay.planes, found.T_world_camera, K)
        return depth_picture(frame.depth_m, K) if kind == "depth" else frame.color

    def draw(frame: Frame, found: ReplayedFrame) -> UInt8Array:
        K = frame.intrinsics_or(replay.intrinsics)
        status = Status(found.index, len(found.sightings), found.objects_known)
        if kind == "proposals":
            return draw_proposals(frame.color, found.T_world_camera, K, found.proposals, status)
        picture = background(frame, found)
        return draw_frame(
            picture,
            found.T_world_camera,
            K,
            found.sightings,
            found.hidden,
            status,
            tinted=kind not in ("heat", "planes"),
            names=replay.names,
            steady=steady,
        )

    return draw
