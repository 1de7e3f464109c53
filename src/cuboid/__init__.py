"""Cuboid: persistent object labels and 3D boxes from an RGB-D video, online, on one CPU core.

Open      open_recording, open_camera, open_results; Recording, LiveCamera, FrameSource, Frame, SkippedFrame,
          Intrinsics, DepthCamera
Track     Tracker, TrackerConfig, Proposals, ProposalSource, Detections, Detector, DriftCorrection; track_recording,
          TrackOptions, ResultOptions, RunHooks, RecordingLike, TrackerLike, Progress, RunOutcome, RunReport, Timing,
          LimitReached, IntoScene
Results   Results, MapQueries, ObjectTable, TrackedObject, Box, PointCloud, ObjectMesh, MapPoints, SupportPlane, Wall,
          Relation, Branch, TextMatch, FrameResult, Sighting, ObjectEvent, Proposal3D, FrameRecord, TrackRow
Scenes    Scene, SceneTracker, SceneObject, SceneRecording, ScenePast, SceneChange, Source
Errors    CuboidError, InputError, ConfigError, FrameError, OutputError, MissingExtraError

>>> import cuboid
>>> results = cuboid.open_results("results")  # doctest: +SKIP
>>> results.cloud(3).save("cup.ply")  # doctest: +SKIP

`help(cuboid.Tracker)` and so on explain each. Metres, seconds, radians; T_world_camera maps camera to world.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cuboid.core.display import draw_with
from cuboid.core.errors import CuboidError as CuboidError

# "import X as X" exports a name to type checkers. There is no `__all__`: with it, `help(cuboid)` would print each class
# in full, some thousand lines.
if TYPE_CHECKING:
    from cuboid.cameras import LiveCamera as LiveCamera
    from cuboid.cameras import open_camera as open_camera
    from cuboid.core.config import TrackerConfig as TrackerConfig
    from cuboid.core.errors import ConfigError as ConfigError
    from cuboid.core.errors import FrameError as FrameError
    from cuboid.core.errors import InputError as InputError
    from cuboid.core.errors import MissingExtraError as MissingExtraError
    from cuboid.core.errors import OutputError as OutputError
    from cuboid.core.frame import Frame as Frame
    from cuboid.core.frame import Intrinsics as Intrinsics
    from cuboid.core.frame import SkippedFrame as SkippedFrame
    from cuboid.core.results import FrameResult as FrameResult
    from cuboid.core.results import MapPoints as MapPoints
    from cuboid.core.results import ObjectEvent as ObjectEvent
    from cuboid.core.results import Proposal3D as Proposal3D
    from cuboid.core.results import Relation as Relation
    from cuboid.core.results import SceneChange as SceneChange
    from cuboid.core.results import Sighting as Sighting
    from cuboid.core.results import SupportPlane as SupportPlane
    from cuboid.core.results import TrackedObject as TrackedObject
    from cuboid.core.results import Wall as Wall
    from cuboid.detection.types import Detections as Detections
    from cuboid.detection.types import Detector as Detector
    from cuboid.geometry.box import Box as Box
    from cuboid.outputs import FrameRecord as FrameRecord
    from cuboid.outputs import LimitReached as LimitReached
    from cuboid.outputs import Results as Results
    from cuboid.outputs import RunReport as RunReport
    from cuboid.outputs import Timing as Timing
    from cuboid.outputs import TrackRow as TrackRow
    from cuboid.outputs import open_results as open_results
    from cuboid.outputs.object_table import ObjectTable as ObjectTable
    from cuboid.outputs.queries import MapQueries as MapQueries
    from cuboid.outputs.queries import PointCloud as PointCloud
    from cuboid.pipeline.options import ResultOptions as ResultOptions
    from cuboid.pipeline.options import RunHooks as RunHooks
    from cuboid.pipeline.options import TrackOptions as TrackOptions
    from cuboid.pipeline.run import track_recording as track_recording
    from cuboid.pipeline.streaming import FrameSource as FrameSource
    from cuboid.poses import DriftCorrection as DriftCorrection
    from cuboid.proposals.types import Proposals as Proposals
    from cuboid.proposals.types import ProposalSource as ProposalSource
    from cuboid.readers import Recording as Recording
    from cuboid.readers.depth_camera import DepthCamera as DepthCamera
    from cuboid.recordings.opening import open_recording as open_recording
    from cuboid.relations import Branch as Branch
    from cuboid.scene import Scene as Scene
    from cuboid.scene import SceneObject as SceneObject
    from cuboid.scene import ScenePast as ScenePast
    from cuboid.scene import SceneRecording as SceneRecording
    from cuboid.scene import SceneTracker as SceneTracker
    from cuboid.scene import Source as Source
    from cuboid.scene.running import IntoScene as IntoScene
    from cuboid.shapes import ObjectMesh as ObjectMesh
    from cuboid.text_search import TextMatch as TextMatch
    from cuboid.tracking.tracker import Tracker as Tracker
    from cuboid.tracking.types import Progress as Progress
    from cuboid.tracking.types import RecordingLike as RecordingLike
    from cuboid.tracking.types import RunOutcome as RunOutcome
    from cuboid.tracking.types import TrackerLike as TrackerLike

draw_with("cuboid.views.notebook")

__version__ = "0.2.0"

# The public names of each module. One is imported when it is first used: `cuboid --help` answers at once, and
# `--threads` can size the pools of libraries, which read their limits when they are imported.
_MODULES = {
    "cuboid.recordings.opening": ("open_recording",),
    "cuboid.cameras": ("open_camera", "LiveCamera"),
    "cuboid.outputs": ("open_results", "RunReport", "Timing", "LimitReached", "Results", "FrameRecord", "TrackRow"),
    "cuboid.readers": ("Recording",),
    "cuboid.pipeline.streaming": ("FrameSource",),
    "cuboid.core.frame": ("Frame", "SkippedFrame", "Intrinsics"),
    "cuboid.readers.depth_camera": ("DepthCamera",),
    "cuboid.tracking.tracker": ("Tracker",),
    "cuboid.core.config": ("TrackerConfig",),
    "cuboid.proposals.types": ("Proposals", "ProposalSource"),
    "cuboid.detection.types": ("Detections", "Detector"),
    "cuboid.poses": ("DriftCorrection",),
    "cuboid.pipeline.options": ("TrackOptions", "ResultOptions", "RunHooks"),
    "cuboid.pipeline.run": ("track_recording",),
    "cuboid.tracking.types": ("RecordingLike", "TrackerLike", "Progress", "RunOutcome"),
    "cuboid.scene.running": ("IntoScene",),
    "cuboid.outputs.queries": ("MapQueries", "PointCloud"),
    "cuboid.outputs.object_table": ("ObjectTable",),
    "cuboid.core.results": (
        "TrackedObject",
        "MapPoints",
        "SupportPlane",
        "FrameResult",
        "Sighting",
        "ObjectEvent",
        "Proposal3D",
        "SceneChange",
        "Relation",
        "Wall",
    ),
    "cuboid.relations.tree": ("Branch",),
    "cuboid.text_search.embeddings": ("TextMatch",),
    "cuboid.shapes.mesh": ("ObjectMesh",),
    "cuboid.geometry.box": ("Box",),
    "cuboid.scene": ("Scene", "SceneTracker", "SceneObject", "SceneRecording", "ScenePast", "Source"),
    "cuboid.core.errors": ("InputError", "ConfigError", "FrameError", "OutputError", "MissingExtraError"),
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'cuboid' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return value


def __dir__() -> list[str]:
    special = {name for name in globals() if name.startswith("__")} - {"__getattr__", "__dir__"}
    return sorted({*_PLACES, "CuboidError", *special})
