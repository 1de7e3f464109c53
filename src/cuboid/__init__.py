"""Cuboid: persistent object labels and 3D boxes from an RGB-D video, online, on one CPU core.

Open      open_recording, open_camera, open_cameras, open_results; Recording, LiveCamera, LiveRig, FrameSource, Frame,
          SkippedFrame, Intrinsics, DepthCamera
Detect    detect: the objects of one picture
Track     Tracker, TrackerConfig, Proposals, ProposalSource, Detections, Detector, DriftCorrection; track_recording,
          TrackOptions, ResultOptions, RunHooks, RecordingLike, TrackerLike, Progress, RunOutcome, RunReport, Timing,
          LimitReached, IntoScene
Results   Results, MapQueries, ObjectTable, TrackedObject, Box, PointCloud, ObjectMesh, MapPoints, SupportPlane, Wall,
          Relation, Branch, TextMatch, FrameResult, Sighting, ObjectEvent, Proposal3D, FrameRecord, TrackRow
Ask       open_place, Place, Filters, FoundObject
Scenes    Scene, SceneTracker, SceneObject, SceneRecording, ScenePast, SceneChange, RecordingInfo
Errors    CuboidError, InputError, ConfigError, FrameError, OutputError, MissingExtraError

>>> import cuboid
>>> results = cuboid.open_results("results")  # doctest: +SKIP
>>> results.cloud(3).save("cup.ply")  # doctest: +SKIP

`help(cuboid.Tracker)` and so on explain each. Metres, seconds, radians; T_world_camera maps camera to world.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from cuboid.ground.core.display import draw_with
from cuboid.ground.core.errors import CuboidError as CuboidError
from cuboid.ground.version import __version__ as __version__

# "import X as X" exports a name to type checkers. There is no `__all__`: with it, `help(cuboid)` would print each class
# in full, some thousand lines.
if TYPE_CHECKING:
    from cuboid.ground.core.config import TrackerConfig as TrackerConfig
    from cuboid.ground.core.errors import ConfigError as ConfigError
    from cuboid.ground.core.errors import FrameError as FrameError
    from cuboid.ground.core.errors import InputError as InputError
    from cuboid.ground.core.errors import MissingExtraError as MissingExtraError
    from cuboid.ground.core.errors import OutputError as OutputError
    from cuboid.ground.core.frame import Frame as Frame
    from cuboid.ground.core.frame import Intrinsics as Intrinsics
    from cuboid.ground.core.frame import SkippedFrame as SkippedFrame
    from cuboid.ground.core.results import FrameResult as FrameResult
    from cuboid.ground.core.results import MapPoints as MapPoints
    from cuboid.ground.core.results import ObjectEvent as ObjectEvent
    from cuboid.ground.core.results import Proposal3D as Proposal3D
    from cuboid.ground.core.results import Relation as Relation
    from cuboid.ground.core.results import SceneChange as SceneChange
    from cuboid.ground.core.results import Sighting as Sighting
    from cuboid.ground.core.results import SupportPlane as SupportPlane
    from cuboid.ground.core.results import TrackedObject as TrackedObject
    from cuboid.ground.core.results import Wall as Wall
    from cuboid.ground.geometry.box import Box as Box
    from cuboid.inputs.cameras import LiveCamera as LiveCamera
    from cuboid.inputs.cameras import LiveRig as LiveRig
    from cuboid.inputs.cameras import open_camera as open_camera
    from cuboid.inputs.cameras import open_cameras as open_cameras
    from cuboid.inputs.readers import Recording as Recording
    from cuboid.inputs.readers.depth_camera import DepthCamera as DepthCamera
    from cuboid.method.detection.types import Detections as Detections
    from cuboid.method.detection.types import Detector as Detector
    from cuboid.method.poses import DriftCorrection as DriftCorrection
    from cuboid.method.proposals.types import Proposals as Proposals
    from cuboid.method.proposals.types import ProposalSource as ProposalSource
    from cuboid.method.relations import Branch as Branch
    from cuboid.method.shapes import ObjectMesh as ObjectMesh
    from cuboid.method.text_search import TextMatch as TextMatch
    from cuboid.results.files import FrameRecord as FrameRecord
    from cuboid.results.files import LimitReached as LimitReached
    from cuboid.results.files import Results as Results
    from cuboid.results.files import RunReport as RunReport
    from cuboid.results.files import Timing as Timing
    from cuboid.results.files import TrackRow as TrackRow
    from cuboid.results.files import open_results as open_results
    from cuboid.results.files.object_table import ObjectTable as ObjectTable
    from cuboid.results.files.queries import MapQueries as MapQueries
    from cuboid.results.files.queries import PointCloud as PointCloud
    from cuboid.runs.pipeline.opening import open_recording as open_recording
    from cuboid.runs.pipeline.options import ResultOptions as ResultOptions
    from cuboid.runs.pipeline.options import RunHooks as RunHooks
    from cuboid.runs.pipeline.options import TrackOptions as TrackOptions
    from cuboid.runs.pipeline.run import track_recording as track_recording
    from cuboid.runs.pipeline.streaming import FrameSource as FrameSource
    from cuboid.runs.scene import RecordingInfo as RecordingInfo
    from cuboid.runs.scene import Scene as Scene
    from cuboid.runs.scene import SceneObject as SceneObject
    from cuboid.runs.scene import ScenePast as ScenePast
    from cuboid.runs.scene import SceneRecording as SceneRecording
    from cuboid.runs.scene import SceneTracker as SceneTracker
    from cuboid.runs.scene.running import IntoScene as IntoScene
    from cuboid.runs.tracking.detect import detect as detect
    from cuboid.runs.tracking.tracker import Tracker as Tracker
    from cuboid.runs.tracking.types import Progress as Progress
    from cuboid.runs.tracking.types import RecordingLike as RecordingLike
    from cuboid.runs.tracking.types import RunOutcome as RunOutcome
    from cuboid.runs.tracking.types import TrackerLike as TrackerLike
    from cuboid.services.queries.answers import FoundObject as FoundObject
    from cuboid.services.queries.filters import Filters as Filters
    from cuboid.services.queries.opening import open_place as open_place
    from cuboid.services.queries.place import Place as Place


def _png_of(value: object) -> bytes:
    from cuboid.results.views.notebook import png_of  # imported here: it takes a while, and only notebooks need it

    return png_of(value)


draw_with(_png_of)

# The public names of each module. One is imported when it is first used: `cuboid --help` answers at once, and
# `--threads` can size the pools of libraries, which read their limits when they are imported.
_MODULES = {
    "cuboid.runs.pipeline.opening": ("open_recording",),
    "cuboid.inputs.cameras": ("open_camera", "open_cameras", "LiveCamera", "LiveRig"),
    "cuboid.results.files": (
        "open_results",
        "RunReport",
        "Timing",
        "LimitReached",
        "Results",
        "FrameRecord",
        "TrackRow",
    ),
    "cuboid.services.queries.opening": ("open_place",),
    "cuboid.services.queries.place": ("Place",),
    "cuboid.services.queries.filters": ("Filters",),
    "cuboid.services.queries.answers": ("FoundObject",),
    "cuboid.inputs.readers": ("Recording",),
    "cuboid.runs.pipeline.streaming": ("FrameSource",),
    "cuboid.ground.core.frame": ("Frame", "SkippedFrame", "Intrinsics"),
    "cuboid.inputs.readers.depth_camera": ("DepthCamera",),
    "cuboid.runs.tracking.detect": ("detect",),
    "cuboid.runs.tracking.tracker": ("Tracker",),
    "cuboid.ground.core.config": ("TrackerConfig",),
    "cuboid.method.proposals.types": ("Proposals", "ProposalSource"),
    "cuboid.method.detection.types": ("Detections", "Detector"),
    "cuboid.method.poses": ("DriftCorrection",),
    "cuboid.runs.pipeline.options": ("TrackOptions", "ResultOptions", "RunHooks"),
    "cuboid.runs.pipeline.run": ("track_recording",),
    "cuboid.runs.tracking.types": ("RecordingLike", "TrackerLike", "Progress", "RunOutcome"),
    "cuboid.runs.scene.running": ("IntoScene",),
    "cuboid.results.files.queries": ("MapQueries", "PointCloud"),
    "cuboid.results.files.object_table": ("ObjectTable",),
    "cuboid.ground.core.results": (
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
    "cuboid.method.relations.tree": ("Branch",),
    "cuboid.method.text_search.embeddings": ("TextMatch",),
    "cuboid.method.shapes.mesh": ("ObjectMesh",),
    "cuboid.ground.geometry.box": ("Box",),
    "cuboid.runs.scene": ("Scene", "SceneTracker", "SceneObject", "SceneRecording", "ScenePast", "RecordingInfo"),
    "cuboid.ground.core.errors": ("InputError", "ConfigError", "FrameError", "OutputError", "MissingExtraError"),
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
