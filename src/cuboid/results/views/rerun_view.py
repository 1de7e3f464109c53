"""`--rerun`: show a run in the rerun viewer as it proceeds."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.results.views.live.watch import TrackerView
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.rerun_scene import RerunScene

# The run itself starts the viewer.
SPAWNED = "viewer"
SUFFIX = ".rrd"
# A picture of 640x480 takes about 50 kB at this quality, and text in it stays clean.
JPEG_QUALITY = 85
# Depth in units of a fifth of a millimetre, as a PNG of the lowest compression level: 150 kB, 4 ms.
UNITS_PER_METRE, FARTHEST_UNITS = 5000.0, 65535
# The map has 5 MB; it is sent again after this many used frames, and at the end.
MAP_EVERY = 60


class RerunView:
    """Context manager: a viewer in which `track_recording` shows a run.

    Parameters
    ----------
    where : str
        A file whose name ends with .rrd, the address of a viewer (rerun+http://HOST:9876/proxy), or `SPAWNED`.
    name : str
        Of the recording.
    intrinsics : Intrinsics

    Raises
    ------
    MissingExtraError
        The rerun SDK is not installed.
    InputError, OutputError
        The viewer cannot be started or reached; the file exists or cannot be written.
    """

    def __init__(self, where: str, name: str, intrinsics: Intrinsics) -> None:
        self._scene = RerunScene(name, "--rerun")
        self._open(where)
        self._intrinsics = intrinsics
        self._places: dict[str, list[Float64Array]] = {}
        self._used = 0
        self._shown: set[int] = set()
        self._last: TrackerView | None = None

    def _open(self, where: str) -> None:
        stream = self._scene.stream
        if where.endswith(SUFFIX):
            if Path(where).exists():
                raise OutputError(f"{where}: exists; name another file for --rerun")
            if not Path(where).absolute().parent.is_dir():
                raise OutputError(f"{where}: cannot be written: there is no folder {Path(where).absolute().parent}")
        try:
            if where.endswith(SUFFIX):
                stream.save(where)
            elif where == SPAWNED:
                stream.spawn()
            else:
                stream.connect_grpc(where)
        except Exception as error:  # a Rust library, which raises no specific classes
            raise InputError(f"--rerun: {where} cannot be opened: {error}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._last is not None:
            self._surroundings(self._last)
        self._scene.close()

    def __call__(self, frame: Frame, result: FrameResult, tracker: TrackerView) -> None:
        """Show a used frame and its results."""
        scene = self._scene
        scene.moment(frame.index, frame.timestamp_s)
        camera = frame.camera_name
        if camera not in self._places:
            self._places[camera] = []
            scene.pinhole(frame.intrinsics_or(self._intrinsics), camera)
        scene.camera(result.T_world_camera, encode_jpeg(frame.color, JPEG_QUALITY), camera)
        scene.depth(_png(frame.depth_m), UNITS_PER_METRE, camera)
        scene.objects(result.sightings, camera)
        lasting = {item.label for item in tracker.objects}
        scene.gone(sorted(self._shown - lasting))
        self._shown = (self._shown & lasting) | {seen.label for seen in result.sightings}
        self._places[camera].append(result.T_world_camera[:3, 3])
        self._last = tracker
        self._used += 1
        if self._used % MAP_EVERY == 1:
            self._surroundings(tracker)

    def _surroundings(self, tracker: TrackerView) -> None:
        """Show the planes, the path and the map, which change slowly."""
        self._scene.up(tracker.up)
        self._scene.map(tracker.map_points(), static=False)
        self._scene.planes(tracker.planes, static=False)
        for camera, places in self._places.items():
            self._scene.path(np.array(places), static=False, camera=camera)


def _png(depth_m: Float32Array) -> bytes:
    units = np.rint(depth_m * np.float32(UNITS_PER_METRE))
    whole = np.where(units < FARTHEST_UNITS, units, 0).astype(np.uint16)
    return bytes(cv2.imencode(".png", whole, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())
