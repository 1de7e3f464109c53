"""Renders a scene into a plain recording folder, with its ground truth beside it.

::

    output/
      camera.json  color/000000.jpg  depth/000000.png  poses.txt     the recording (docs/recordings.md)
      truth.json  true_trajectory.txt  true_cloud.ply                what it shows
      faults.json                                                    what was broken on purpose, if anything
      rig.json  camera-1/ camera-2/ ...                              of a rig: a recording with a truth for each camera
"""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.folder import ResultFolder, writing
from cuboid.ground.geometry import se3
from cuboid.inputs.recordings.converting import png
from cuboid.inputs.recordings.rig import RIG_FILE
from cuboid.lab.synthetic import truth
from cuboid.lab.synthetic.faults import named, spoil
from cuboid.lab.synthetic.paths import POSE_NOISES
from cuboid.lab.synthetic.raycast import EXTRA, MODULES
from cuboid.lab.synthetic.rigs import document, name_of, of_camera
from cuboid.lab.synthetic.scene import FRAMES_PER_S, Scene, SceneObject, require_known
from cuboid.lab.synthetic.sensors import SENSORS
from cuboid.lab.synthetic.view import Rendered, SceneView
from cuboid.results.files.text import LENGTH, number
from cuboid.results.views.pixels import encode_jpeg

# Units of the depth images: 0.2 mm, a seventh of a structured-light step at 0.7 m; up to 13 m.
DEPTH_UNITS_PER_M = 5000
RECORDING_JPEG_QUALITY = 92
# Every n-th frame and pixel contributes to the labelled cloud.
CLOUD_EVERY_FRAMES, CLOUD_EVERY_PIXELS = 5, 3
# Minimum image size: below it an object has only a few pixels.
SMALLEST_SIZE = (64, 48)

Progress = Callable[[int, int], None]
CloudPart = tuple[Float32Array, UInt8Array, npt.NDArray[np.int32]]


@dataclass(frozen=True, slots=True)
class _Done:
    """Results of a rendered frame besides images: visible fractions (M,), those of ghosts, cloud points."""

    fractions: Float64Array
    empty: Float64Array
    cloud: CloudPart | None


@dataclass(frozen=True, slots=True)
class Shown:
    """Number of frames in which a recording shows a sufficient fraction of each object.

    Attributes
    ----------
    objects : dict of int to int
        Frames by object id.
    ghosts : dict of int to int
        Frames that show the empty place of an object that is gone, by id.
    """

    objects: dict[int, int]
    ghosts: dict[int, int]


class _Renderer:
    """Renders frames of a scene into the files of a folder."""

    def __init__(self, scene: Scene, size: tuple[int, int], sensor: str, folder: Path) -> None:
        self._views = [SceneView(scene, scene.intrinsics(*size, camera=k)) for k in range(scene.cameras)]
        self._folders = [camera for camera, _ in _cameras(scene, folder)]
        self._T_world_room = scene.T_world_room
        self._sensor = sensor

    def __call__(self, frame: int) -> _Done:
        turn, k = divmod(frame, len(self._views))
        view, folder, name = self._views[k], self._folders[k], f"{turn:06d}"
        rendered = view.render(frame, self._sensor)
        (folder / "color" / f"{name}.jpg").write_bytes(encode_color(rendered.color))
        (folder / "depth" / f"{name}.png").write_bytes(encode_depth(rendered.depth_m))
        fractions = view.visible_fractions(frame, rendered.hits)
        empty = view.empty_fractions(frame, rendered.hits)
        return _Done(fractions, empty, self._cloud(view, rendered) if turn % CLOUD_EVERY_FRAMES == 0 else None)

    def _cloud(self, view: SceneView, rendered: Rendered) -> CloudPart:
        each = (slice(None, None, CLOUD_EVERY_PIXELS),) * 2
        hits, depth = rendered.hits, rendered.hits.depth_m[each]
        # Moving bodies have no fixed place, so they are left out of the cloud.
        seen = (depth > 0) & ~view.face_moves[hits.face[each]]
        points = se3.transform(self._T_world_room, (hits.eye + hits.rays[each] * depth[..., None])[seen])
        return points.astype(np.float32), rendered.color[each][seen], view.labels(hits)[each][seen]


def render_recording(
    scene: Scene,
    path: PathLike,
    *,
    sensor: str = "structured-light",
    pose_noise: str = "none",
    faults: Sequence[str] = (),
    size: tuple[int, int] = (640, 480),
    workers: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> Shown:
    """Render a scene into a plain recording folder; the same arguments write the same bytes.

    A scene with a rig becomes a folder with a `rig.json` and a recording for each camera. The truth beside `rig.json`
    counts the frames of all cameras; each recording also has its own.

    Parameters
    ----------
    scene : Scene
    path : path
        The folder, which appears when it is complete.
    sensor : str
        One of `SENSORS`.
    pose_noise : str
        One of `POSE_NOISES`: errors of the written poses; the ground truth has the exact ones.
    faults : sequence of str
        Names in `cuboid.lab.synthetic.faults.FAULTS`: faults that are added at the end.
    size : (int, int)
        Width and height of the images, pixels.
    workers : int
        Number of rendering processes; it has no effect on the result.
    force : bool
        Whether a synthetic recording at `path` may be replaced.
    progress : callable, optional
        Called with the number of finished frames, from 0, and the total number.

    Returns
    -------
    Shown

    Raises
    ------
    InputError
        An argument is unknown or out of range.
    OutputError
        The folder exists and is no synthetic recording, or `force` is False; or it cannot be written.
    """
    path = as_path(path)
    _check(sensor, pose_noise, size)
    require(MODULES[0], "cuboid synth", EXTRA)  # raised here, not in the rendering processes
    named(faults, scene.frames // scene.cameras)
    if force and (path / truth.TRUTH).is_file():
        with writing(path):
            shutil.rmtree(path)
    with ResultFolder(path) as folder, writing(path):
        work = folder.file("")
        cameras = _cameras(scene, work)
        for camera, _ in cameras:
            (camera / "color").mkdir(parents=True)
            (camera / "depth").mkdir()
        done: list[_Done] = []
        if progress is not None:
            progress(0, scene.frames)
        with _results(partial(_Renderer, scene, size, sensor, work), scene.frames, workers) as results:
            for result in results:
                done.append(result)
                if progress is not None:
                    progress(len(done), scene.frames)
        fractions = np.array([one.fractions for one in done])
        for k, (camera, seen) in enumerate(cameras):
            _write_texts(camera, seen, seen.intrinsics(*size), pose_noise)
            truth.write_truth(camera / truth.TRUTH, seen, seen.intrinsics(*size), fractions[k :: len(cameras)])
        if scene.rig is not None:
            _write_rig(work, scene, size, fractions)
        cloud = truth.LabelledCloud()
        for one in done:
            if one.cloud is not None:
                cloud.add(*one.cloud)
        cloud.write(work / truth.CLOUD)
        if faults:
            first, seen = cameras[0]
            spoil(first, faults, seen.frames, np.random.default_rng([scene.seed, 3]))
        folder.commit()
    empty = np.array([one.empty for one in done])
    return Shown(_frames_shown(scene.objects, fractions), _frames_shown(scene.ghosts, empty))


def _frames_shown(bodies: Sequence[SceneObject], fractions: Float64Array) -> dict[int, int]:
    """Return by id the number of frames that show a sufficient fraction (N, M) of each body."""
    counts = (fractions >= truth.SHOWN_FRACTION).sum(axis=0).tolist()
    return {body.id: count for body, count in zip(bodies, counts, strict=True)}


def _cameras(scene: Scene, folder: Path) -> list[tuple[Path, Scene]]:
    """Return the folder of each camera's recording, with the scene that this camera sees."""
    if scene.rig is None:
        return [(folder, scene)]
    return [(folder / name_of(k), of_camera(scene, k)) for k in range(scene.rig.cameras)]


def _write_rig(folder: Path, scene: Scene, size: tuple[int, int], fractions: Float64Array) -> None:
    """Write `rig.json`, the times of the cameras' frames, and the truth of all frames."""
    assert scene.rig is not None
    (folder / RIG_FILE).write_text(json.dumps(document(scene), indent=1) + "\n", encoding="utf-8")
    for k in range(scene.rig.cameras):
        frames = range(k, scene.frames, scene.rig.cameras)
        lines = "".join(f"{j} {number(i / FRAMES_PER_S, LENGTH)}\n" for j, i in enumerate(frames))
        (folder / name_of(k) / "timestamps.txt").write_text(lines, encoding="utf-8")
    truth.write_truth(folder / truth.TRUTH, scene, scene.intrinsics(*size), fractions)
    truth.write_trajectory(folder / truth.TRAJECTORY, scene.T_world_camera)


def encode_color(color: UInt8Array) -> bytes:
    """Return an RGB image (H, W, 3) as JPEG."""
    return encode_jpeg(color, RECORDING_JPEG_QUALITY)


def encode_depth(depth_m: Float32Array) -> bytes:
    """Return depth in metres (H, W) as a 16-bit PNG in `DEPTH_UNITS_PER_M`."""
    units = np.rint(np.minimum(depth_m * np.float32(DEPTH_UNITS_PER_M), 65534)).astype(np.uint16)
    return png(units)


def _check(sensor: str, pose_noise: str, size: tuple[int, int]) -> None:
    require_known("sensor", sensor, SENSORS)
    require_known("pose noise", pose_noise, POSE_NOISES)
    if size[0] < SMALLEST_SIZE[0] or size[1] < SMALLEST_SIZE[1]:
        raise InputError(f"images must be at least {SMALLEST_SIZE[0]}x{SMALLEST_SIZE[1]}, got {size[0]}x{size[1]}")


def _write_texts(folder: Path, scene: Scene, intrinsics: Intrinsics, pose_noise: str) -> None:
    camera = {name: getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    camera["depth_units_per_metre"] = DEPTH_UNITS_PER_M
    (folder / "camera.json").write_text(json.dumps(camera) + "\n", encoding="utf-8")
    poses = POSE_NOISES[pose_noise](scene.T_world_camera, np.random.default_rng([scene.seed, 2]))
    lines = truth.pose_lines([str(k) for k in range(scene.frames)], poses)
    (folder / "poses.txt").write_text("# number tx ty tz qx qy qz qw\n" + lines, encoding="utf-8")
    truth.write_trajectory(folder / truth.TRAJECTORY, scene.T_world_camera)


_renderer: _Renderer | None = None


def _begin(make: Callable[[], _Renderer]) -> None:
    """Create the renderer of a worker process."""
    global _renderer
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends its workers
    _renderer = make()


def _render(frame: int) -> _Done:
    assert _renderer is not None, "a worker begins with _begin"
    return _renderer(frame)


@contextmanager
def _results(make: Callable[[], _Renderer], frames: int, workers: int) -> Iterator[Iterator[_Done]]:
    """Yield the rendered frames in order.

    The first frame is rendered in this process: this compiles the kernels, and the workers load them.
    """
    render = make()
    if workers <= 1:
        yield map(render, range(frames))
        return
    first = render(0)
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, (make,)) as pool:
        try:
            yield chain([first], pool.map(_render, range(1, frames), chunksize=4))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
