"""First, last and later sightings of objects in a result folder."""

from __future__ import annotations

from pathlib import PurePath

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.results import TrackedObject
from cuboid.results.files import Results
from cuboid.services.queries.answers import Later, Seen
from cuboid.services.queries.looking import frames_that_show, seen_from


def seen_in_results(results: Results, frame: int, item: TrackedObject) -> Seen:
    """Return a frame that saw an object, with its time and the position of the camera."""
    pose = results.poses.get(frame)
    time_s, T = (None, None) if pose is None else (pose.timestamp_s, pose.T_world_camera)
    return seen_from(frame, item.box, time_s=time_s, camera=name_of(results.report.recording), T_world_camera=T)


def later_in_results(results: Results, item: TrackedObject) -> Later:
    """Return what the frames after the last sighting of an object show."""
    gone = [one.frame for one in results.events if one.label == item.label and one.event == "gone"]
    if gone and gone[-1] >= item.last_frame:
        return Later("gone", seen_in_results(results, gone[-1], item))
    if item.last_frame >= results.last_frame:
        return Later("there")
    poses = {frame: row.T_world_camera for frame, row in results.poses.items()}
    far_m = float(results.report.config.get("tracker", {}).get("max_depth_m", TrackerConfig().max_depth_m))
    shown = frames_that_show(item.box, poses, item.last_frame, results.found.intrinsics, far_m)
    return Later("not seen", seen_in_results(results, shown[0], item)) if shown else Later("not looked at")


def name_of(path: str) -> str | None:
    """Return the name of a recording; None if a run was given frames without a recording."""
    return PurePath(path).name or None
