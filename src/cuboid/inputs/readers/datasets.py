"""Data sets whose image names contain the frame number: one reader, and a table of their differences.

7-Scenes (Shotton et al., "Scene coordinate regression forests", CVPR 2013), and recordings in its format::

    chess/
      seq-01/                          <- the recording
        frame-000000.color.png         8-bit color (.jpg as well)
        frame-000000.depth.png         16-bit, millimetres; 0 and 65535 are no reading
        frame-000000.pose.txt          4x4 matrix, camera to world; inf or nan: the frame is lost; may be absent
        ...
      camera-intrinsics.txt            3x3 matrix, here or in seq-01; may be absent

The frames may also be in the upper folder itself. As published, depth and poses belong to the depth camera: depth is
registered to the color image, and the poses are converted to the color camera. If the folder or the user gives another
camera, images count as registered unless a depth camera is given too.

3RScan (Wald et al., "RIO: 3D object instance re-localization in changing indoor environments", ICCV 2019), with
sequence.zip unpacked or not::

    0958220d-e2c2-2de1-9710-c37018da1883/
      sequence/                        <- the recording
        _info.txt                      lines "m_colorWidth = 960", ...: sizes, both cameras, units of depth a metre
        frame-000000.color.jpg         8-bit
        frame-000000.depth.pgm         16-bit; .png as well
        frame-000000.pose.txt          4x4 matrix, camera to world

Color has a higher resolution than depth, from the same position: depth is registered to color.

UW RGB-D Scenes v2 (Lai, Bo, Fox, "Unsupervised feature learning for 3D scene labeling", ICRA 2014)::

    rgbd-scenes-v2/
      imgs/scene_01/                   <- the recording
        00000-color.png                8-bit color (.jpg as well)
        00000-depth.png                16-bit, 1/10000 m, 0 is no reading, aligned to color
        ...
      pc/01.pose                       one line per frame: qw qx qy qz tx ty tz, camera to world; may be absent

The frame number is the line number, so a part of a scene keeps its poses. The pose file is also found inside
the scene's folder.

Replica as rendered by NICE-SLAM, and recordings with the same layout::

    Replica/
      cam_params.json                  {"camera": {"w":, "h":, "fx":, "fy":, "cx":, "cy":, "scale":}}, or in office0
      office0/                         <- the recording
        results/frame000000.jpg        8-bit color
        results/depth000000.png        16-bit; scale units are a metre
        traj.txt                       a line a frame: 16 numbers, camera to world, row by row; may be absent

Scans of ScanNet as its own tool extracts them (Dai et al., CVPR 2017)::

    scene0000_00/                      <- the recording
      color/0.jpg                      8-bit, 1296x968
      depth/0.png                      16-bit, 640x480, millimetres
      pose/0.txt                       4x4 matrix, camera to world; inf: the frame is lost
      intrinsic/intrinsic_color.txt    4x4 matrices
      intrinsic/intrinsic_depth.txt

Color and depth were taken from the same position by two cameras: depth is registered to color.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError, shown
from cuboid.ground.formats.reading import UnreadableError, names_in, text_lines
from cuboid.inputs.readers.calibration import CAMERA_FILE
from cuboid.inputs.readers.depth_camera import DepthCamera, check_number
from cuboid.inputs.readers.documents import read_object
from cuboid.inputs.readers.image_folder import images_in
from cuboid.inputs.readers.images import decode_depth, image_dimensions
from cuboid.inputs.readers.netpbm import read_netpbm
from cuboid.inputs.readers.posetext import (
    numbered_rows,
    parse_numbers,
    pinhole_of,
    pose_from_matrix,
    pose_from_quaternion,
)
from cuboid.inputs.readers.reader import READERS, Calibration, FrameEntry, ImageSource, Listing, Reader, has_file

# The files of each kind (color, depth, pose), by the number in their names.
Files = Mapping[str, Mapping[str, Path]]
Cameras = tuple[Calibration | None, float | None]
# Returns the pose of a frame by its number.
PoseOf = Callable[[str], Float64Array]

MILLIMETRES = 1000.0
MATRIX = "the 16 numbers of a 4x4 matrix"
# A matrix has four lines; at most this many lines of a file are read.
MAX_LINES = 20

FRAME_FILE = re.compile(r"frame-(?P<number>\d+)\.(?P<kind>color|depth|pose)\.(png|jpg|jpeg|pgm|txt)")
UW_FILE = re.compile(r"(?P<number>\d+)-(?P<kind>color|depth)\.(png|jpg|jpeg)")
REPLICA_FILE = re.compile(r"(?P<kind>frame|depth)(?P<number>\d+)\.(jpg|png)")

# Color and depth of 7-Scenes are not registered. Its page gives the depth camera (585, 585, 320, 240), but not the
# color camera, which is a Kinect's: 525 (OpenNI's), 2.5 cm beside the other. The positions of depth edges in color
# images (u_depth = 1.11 u_color - 29, v_depth = 1.11 v_color - 24) confirm both numbers for objects 2 m away, and the
# color camera points 2.2 pixels lower: a tilt of 0.0042.
_TILT = 0.0042
_T_COLOR_DEPTH = np.array(
    [
        [1.0, 0.0, 0.0, -0.025],
        [0.0, np.cos(_TILT), -np.sin(_TILT), 0.0],
        [0.0, np.sin(_TILT), np.cos(_TILT), 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_KINECT = (640, 480)
_SEVEN_SCENES_DEPTH = DepthCamera(585.0, 585.0, 320.0, 240.0, _KINECT, _T_COLOR_DEPTH)
SEVEN_SCENES = Calibration(
    525.0, 525.0, 320.0, 240.0, _KINECT, "published for 7-Scenes", depth_camera=_SEVEN_SCENES_DEPTH
)
# Not the 570.3, (320, 240) of the dataset's page: with those the given poses are inconsistent, and every object appears
# as two or three ghosts 2-3 cm apart. Scene 01, fused with its poses, is sharpest here.
UW_SCENES = Calibration(534.8, 534.8, 320.9, 246.9, _KINECT, "fitted to the poses of UW RGB-D Scenes v2")

# 3RScan: the file of both cameras, and its fields.
INFO = "_info.txt"
INFO_FIELDS = ("m_colorWidth", "m_colorHeight", "m_depthWidth", "m_depthHeight", "m_depthShift")
INFO_CAMERAS = ("m_calibrationColorIntrinsic", "m_calibrationDepthIntrinsic")
RESULTS, TRAJECTORY, PARAMETERS = "results", "traj.txt", "cam_params.json"
PARAMETER_FIELDS = ("fx", "fy", "cx", "cy", "w", "h", "scale")
COLOR_K, DEPTH_K = "intrinsic/intrinsic_color.txt", "intrinsic/intrinsic_depth.txt"


@dataclass(frozen=True, slots=True)
class DataSet:
    """The common layout of a data set's folders.

    Attributes
    ----------
    expects, recognises
        As in `Reader`.
    files : callable
        Path -> the files of each frame.
    cameras : callable
        (path, files) -> the camera and the depth units per metre; raises InputError if a file has another format.
    poses : callable
        (path, files) -> a function that returns the pose of a frame; None if there are no poses.
    upper : callable
        Path -> the parent folder that may contain the camera of several recordings.
    poses_of_depth : bool
        As in `Listing`.
    by_names : bool
        Whether the names of the images alone define the layout; without poses the camera is then only assumed.
    """

    expects: str
    recognises: Callable[[Path], bool]
    files: Callable[[Path], Files]
    cameras: Callable[[Path, Files], Cameras]
    poses: Callable[[Path, Files], PoseOf | None]
    upper: Callable[[Path], Path] = lambda path: path
    poses_of_depth: bool = False
    by_names: bool = False

    def read(self, path: Path) -> Listing:
        """List the frames; raise InputError if a file of the recording has another format."""
        files = self.files(path)
        calibration, units = self.cameras(path, files)
        pose = self.poses(path, files)
        frames = [
            FrameEntry(
                color=files[number].get("color"),
                depth=_depth_source(files[number].get("depth")),
                pose=None if pose is None else partial(pose, number),
            )
            for number in sorted(files, key=int)
        ]
        folders = tuple(dict.fromkeys((path, self.upper(path))))
        guessed = self.by_names and pose is None
        assumed = "the layout was recognised by the names of the images alone" if guessed else ""
        return Listing(frames, units, calibration, folders, poses_of_depth=self.poses_of_depth, assumed=assumed)


def _named(pattern: re.Pattern[str], folder: Path) -> Files:
    """Return the files of a folder whose names match."""
    files: dict[str, dict[str, Path]] = {}
    for name in sorted(names_in(folder)):  # of two image formats, the original .png comes last and stays
        if match := pattern.fullmatch(name):
            kind = "color" if match["kind"] == "frame" else match["kind"]
            files.setdefault(match["number"], {})[kind] = folder / name
    return files


def _depth_source(file: Path | None) -> ImageSource | None:
    return partial(_netpbm_depth, file) if file is not None and file.suffix == ".pgm" else file


def _netpbm_depth(file: Path) -> npt.NDArray[np.uint16]:
    return np.asarray(decode_depth(lambda: read_netpbm(file, f"depth image {file.name}"), file.name), np.uint16)


def _published(calibration: Calibration, units: float, path: Path, files: Files) -> Cameras:
    return calibration, units


# --- poses: one file or one line per frame


def _files_of_poses(name: str, path: Path, files: Files) -> PoseOf:
    return lambda number: _matrix_file(path / name.format(number))


def _matrix_file(path: Path) -> Float64Array:
    """Read T_world_camera from the file of one frame."""
    try:
        values = parse_numbers(" ".join(islice(text_lines(path), MAX_LINES)), 16, MATRIX)
    except UnreadableError as error:
        what = f"the camera pose is missing: {path.name}" if error.missing else f"{path.name} {error.reason}"
        raise FrameError(what) from None
    except ValueError as error:
        raise FrameError(f"no camera pose: {path.name}: {error}") from None
    return pose_from_matrix(np.reshape(values, (4, 4)), path.name)


def _lines_of_matrices(path: Path, files: Files) -> PoseOf | None:
    if not (path / TRAJECTORY).is_file():
        return None
    rows = numbered_rows(path / TRAJECTORY, 16, MATRIX)

    def pose(number: str) -> Float64Array:
        if int(number) >= len(rows):
            raise FrameError(f"{TRAJECTORY} has {len(rows)} lines, none for frame {int(number)}")
        line, values = rows[int(number)]
        return pose_from_matrix(np.reshape(values, (4, 4)), f"{TRAJECTORY} line {line}")

    return pose


def _lines_of_quaternions(path: Path, files: Files) -> PoseOf | None:
    """Return the poses of UW RGB-D Scenes v2; a bad line only affects its own frame."""
    number = path.name.removeprefix("scene_")
    here = (_above_images(path) / "pc" / f"{number}.pose", path / f"{number}.pose")
    file = next((one for one in here if one.is_file()), None)
    if file is None:
        return None
    lines = list(text_lines(file))
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise InputError(f"{file} is empty; without the file the recording counts as one without poses")

    def pose(number: str) -> Float64Array:
        place = int(number)
        if place >= len(lines):
            raise FrameError(f"{file.name} has {len(lines)} lines, none for frame number {place}")
        where = f"{file.name} line {place + 1}"
        try:
            values = parse_numbers(lines[place], 7, "qw qx qy qz tx ty tz")
        except ValueError as error:
            raise FrameError(f"{where}: {error}") from None
        return pose_from_quaternion(values[:4], values[4:], where)

    return pose


def _above_images(path: Path) -> Path:
    return path.parent.parent if path.parent.name == "imgs" else path


# --- cameras


def _info(path: Path, files: Files) -> Cameras:
    """Return the two cameras of 3RScan, and the depth units per metre."""
    file, values = path / INFO, {}
    for line in text_lines(file):
        name, equals, value = line.partition("=")
        if equals:
            values[name.strip()] = value.strip()

    def numbers(name: str, count: int, expected: str) -> list[float]:
        try:
            found = parse_numbers(values.get(name, ""), count, expected)
            if count == 1 and not 0 < found[0] < 1e9:
                raise ValueError(f"expected {expected}, got {shown(values[name])}")
        except ValueError as error:
            raise InputError(f"{file}: {name}: {error}") from None
        return found

    sizes = [numbers(name, 1, "a number above 0")[0] for name in INFO_FIELDS]
    width, height, depth_width, depth_height = map(int, sizes[:4])
    matrices = (numbers(name, 16, "the 16 numbers of a camera matrix") for name in INFO_CAMERAS)
    color, depth = (
        pinhole_of(np.reshape(one, (4, 4)).tolist(), f"{file}: {name}")
        for one, name in zip(matrices, INFO_CAMERAS, strict=True)
    )
    camera = DepthCamera(*depth, (depth_width, depth_height), np.eye(4))
    return Calibration(*color, (width, height), INFO, depth_camera=camera), sizes[4]


def _parameters(path: Path, files: Files) -> Cameras:
    """Return the camera of Replica and the depth units per metre; None for values without a file."""
    file = next((one / PARAMETERS for one in (path, path.parent) if (one / PARAMETERS).is_file()), None)
    if file is None:
        return None, None
    camera = read_object(file).get("camera")
    if not isinstance(camera, dict):
        raise InputError(f"{file}: expected 'camera' with {', '.join(PARAMETER_FIELDS)}")
    for name in PARAMETER_FIELDS:
        check_number(name, camera.get(name), str(file), "camera.")
    fx, fy, cx, cy, width, height, scale = (float(camera[name]) for name in PARAMETER_FIELDS)
    return Calibration(fx, fy, cx, cy, (int(width), int(height)), file.name), scale


def _two_matrices(path: Path, files: Files) -> Cameras:
    """Return the two cameras of ScanNet; without a file for depth, its camera is the color camera."""
    sizes = [_size_of(files, kind) for kind in ("color", "depth")]
    color, depth = _camera_matrix(path / COLOR_K), None
    if (path / DEPTH_K).is_file() and sizes[0] is not None and sizes[1] is not None:
        depth = DepthCamera(*_camera_matrix(path / DEPTH_K), sizes[1], np.eye(4))
    return Calibration(*color, sizes[0], COLOR_K, depth_camera=depth), MILLIMETRES


def _size_of(files: Files, kind: str) -> tuple[int, int] | None:
    first = next((files[number][kind] for number in sorted(files, key=int) if kind in files[number]), None)
    return None if first is None else image_dimensions(first)


def _camera_matrix(path: Path) -> tuple[float, float, float, float]:
    """Read fx, fy, cx, cy from the rows of a camera matrix, 4x4 or 3x3."""
    rows = [row for _, row in numbered_rows(path, None, "numbers")]
    if len(rows) not in (3, 4) or any(len(row) != len(rows) for row in rows):
        raise InputError(f"{path}: expected a 4x4 matrix, got {len(rows)} rows")
    return pinhole_of(rows, path)


# --- the data sets


def _is_scannet(path: Path) -> bool:
    folders = all((path / name).is_dir() for name in ("color", "depth", "pose"))
    return folders and (path / COLOR_K).is_file() and not (path / CAMERA_FILE).is_file()


def _files_of_scannet(path: Path) -> Files:
    files: dict[str, dict[str, Path]] = {}
    for kind in ("color", "depth"):
        for file in images_in(path / kind):
            if re.fullmatch(r"\d+", file.stem):
                files.setdefault(str(int(file.stem)), {})[kind] = file
    if not files:
        raise InputError(f"{path}: color/ and depth/ hold no images")
    return files


def _seven_scenes_poses(path: Path, files: Files) -> PoseOf | None:
    some = any("pose" in of_frame for of_frame in files.values())
    return _files_of_poses("frame-{}.pose.txt", path, files) if some else None


DATA_SETS = {
    "7-scenes": DataSet(
        "frame-NNNNNN.color.png|jpg, frame-NNNNNN.depth.png",
        lambda path: has_file(path, FRAME_FILE) and not (path / INFO).is_file(),
        partial(_named, FRAME_FILE),
        partial(_published, SEVEN_SCENES, MILLIMETRES),
        _seven_scenes_poses,
        lambda path: path.parent,
        poses_of_depth=True,  # KinectFusion made the poses from depth alone
        by_names=True,
    ),
    "3rscan": DataSet(
        "_info.txt, frame-NNNNNN.color.jpg, .depth.pgm, .pose.txt",
        lambda path: (path / INFO).is_file() and has_file(path, FRAME_FILE),
        partial(_named, FRAME_FILE),
        _info,
        partial(_files_of_poses, "frame-{}.pose.txt"),
    ),
    "uw-rgbd-scenes-v2": DataSet(
        "NNNNN-color.png|jpg, NNNNN-depth.png",
        lambda path: has_file(path, UW_FILE),
        partial(_named, UW_FILE),
        partial(_published, UW_SCENES, 10000.0),
        _lines_of_quaternions,
        _above_images,
        by_names=True,
    ),
    "replica": DataSet(
        "results/frameNNNNNN.jpg, results/depthNNNNNN.png",
        lambda path: (path / RESULTS).is_dir() and has_file(path / RESULTS, REPLICA_FILE),
        lambda path: _named(REPLICA_FILE, path / RESULTS),
        _parameters,
        _lines_of_matrices,
        lambda path: path.parent,
    ),
    "scannet": DataSet(
        "color/, depth/, pose/, intrinsic/intrinsic_color.txt",
        _is_scannet,
        _files_of_scannet,
        _two_matrices,
        partial(_files_of_poses, "pose/{}.txt"),
    ),
}
for _name, _one in DATA_SETS.items():
    READERS.register(_name)(Reader(_one.expects, _one.recognises, _one.read))
