"""Containers of any size: how long they take to open, and whether memory stays flat while they are tracked.

python benchmarks/large_containers.py RECORDING [KIND ...] [--gigabytes G] [--frames N] [--folder DIR] [--json]

The frames of RECORDING, which needs poses, are written there and back N times into each container by its own library,
with what else a container of that size holds between them: messages of other topics, a track of infrared images, other
files. Where a format allows, that is a hole in the file and takes no room on disk. Each container is opened and tracked
in a process of its own, from the disk, then removed. Memory is what the process holds, without the files that the
system keeps.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import struct
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cuboid import CuboidError, open_recording
from cuboid.ground.core.frame import Frame
from cuboid.ground.geometry import se3
from cuboid.inputs.readers import Recording
from cuboid.inputs.recordings.converting import pose_text
from tables import dump, show

HEADER = (
    "container",
    "GB",
    "on disk GB",
    "frames",
    "open s",
    "MB at the start",
    "at 10 %",
    "at 50 %",
    "at the end",
    "ms",
)
# Frames of the recording that are written again and again; and at which parts of them memory is read.
KEPT_FRAMES = 60
PARTS = (0.1, 0.5, 1.0)
START_NS, STEP_NS = 1_700_000_000_000_000_000, 33_333_333
ROSBAGS = {"bag": ".bag", "db3": "", "mcap": ""}
# The least of what else is written with a frame, bytes.
MIN_BALLAST = 4096


class Source:
    """Frames of a recording, there and back.

    Parameters
    ----------
    recording : Recording
    count : int
        How many.
    """

    def __init__(self, recording: Recording, count: int) -> None:
        self.intrinsics, self.count = recording.intrinsics, count
        frames = recording.iterate(limit=KEPT_FRAMES)
        self._frames = [frame for frame in frames if isinstance(frame, Frame) and frame.T_world_camera is not None]
        if not self._frames:
            raise SystemExit(f"{recording.path}: no frame with a pose")

    def __iter__(self) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Give number, color, depth in millimetres and pose."""
        there_and_back = [*self._frames, *self._frames[-2:0:-1]]
        for k in range(self.count):
            frame = there_and_back[k % len(there_and_back)]
            assert frame.T_world_camera is not None
            yield k, frame.color, np.rint(1000 * frame.depth_m).astype(np.uint16), frame.T_world_camera


def png(image: np.ndarray) -> bytes:
    stored = image[..., ::-1] if image.ndim == 3 else image
    return cv2.imencode(".png", np.ascontiguousarray(stored), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


def write_rosbag(kind: str, source: Source, folder: Path, ballast: int) -> Path:
    """A bag of ROS with a topic of something else."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    path = folder / f"recording{ROSBAGS[kind]}"
    if kind == "bag":
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
        writer: Any = Writer1(path)
    else:
        plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
        writer = Writer2(path, version=9, storage_plugin=plugin)
    messages = _Messages(store, kind == "bag")
    nothing = np.zeros(ballast, np.uint8)
    with writer:
        connections: dict[str, Any] = {}

        def publish(topic: str, message: Any, time_ns: int) -> None:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            serialize = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
            writer.write(connections[topic], time_ns, serialize(message, name))

        publish("/camera/color/camera_info", messages.info(source.intrinsics, START_NS), START_NS)
        for k, color, depth_mm, T in source:
            t = START_NS + k * STEP_NS
            publish("/tf", messages.transform(T, t), t)
            publish("/camera/color/image_raw", messages.image(color, "rgb8", t), t)
            publish("/camera/aligned_depth_to_color/image_raw", messages.image(depth_mm, "16UC1", t), t)
            publish("/lidar/raw", messages.image(nothing.reshape(1, -1), "8UC1", t), t)
    return path


class _Messages:
    """Makes messages of ROS 1 or 2."""

    def __init__(self, store: Any, is_ros1: bool) -> None:
        self._types, self._is_ros1 = store.types, is_ros1

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)

    def _header(self, frame: str, time_ns: int) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        more = {"seq": 0} if self._is_ros1 else {}
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def image(self, pixels: np.ndarray, encoding: str, time_ns: int) -> Any:
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
        height, width = pixels.shape[:2]
        return self._make(
            "sensor_msgs/msg/Image",
            header=self._header("camera", time_ns),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=data.size // height,
            data=data,
        )

    def info(self, c: Any, time_ns: int) -> Any:
        K, D, R, P = ("K", "D", "R", "P") if self._is_ros1 else ("k", "d", "r", "p")
        matrix = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1], np.float64)
        roi = self._make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        arrays = {K: matrix, D: np.zeros(5), R: np.eye(3).ravel(), P: np.zeros(12)}
        return self._make(
            "sensor_msgs/msg/CameraInfo",
            header=self._header("camera", time_ns),
            height=c.height,
            width=c.width,
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **arrays,
        )

    def transform(self, T: np.ndarray, time_ns: int) -> Any:
        w, x, y, z = (float(v) for v in se3.quat_wxyz_from_rotation(T[:3, :3]))
        moved = self._make("geometry_msgs/msg/Vector3", x=float(T[0, 3]), y=float(T[1, 3]), z=float(T[2, 3]))
        turned = self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        one = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header("world", time_ns),
            child_frame_id="camera",
            transform=self._make("geometry_msgs/msg/Transform", translation=moved, rotation=turned),
        )
        return self._make("tf2_msgs/msg/TFMessage", transforms=[one])


def write_sens(source: Source, folder: Path, ballast: int) -> Path:
    """A file of ScanNet; behind each color image is a hole."""
    c, path = source.intrinsics, folder / "recording.sens"
    K = np.eye(4, dtype="<f4")
    K[:2, :3] = [[c.fx, 0, c.cx], [0, c.fy, c.cy]]
    eye, size = np.eye(4, dtype="<f4").tobytes(), (c.width, c.height)
    with path.open("wb") as file:
        file.write(struct.pack("<IQ", 4, 4) + b"made" + (K.tobytes() + eye) * 2)
        file.write(struct.pack("<iiIIIIfQ", 1, 1, *size, *size, 1000.0, source.count))
        for k, color, depth_mm, T in source:
            image, depth = png(color), zlib.compress(depth_mm.tobytes(), 1)
            times = k * STEP_NS // 1000
            file.write(T.astype("<f4").tobytes())
            file.write(struct.pack("<QQQQ", times, times, len(image) + ballast, len(depth)) + image)
            file.seek(ballast, io.SEEK_CUR)
            file.write(depth)
    return path


def plain_files(source: Source) -> Iterator[tuple[str, bytes]]:
    """The files of a plain folder."""
    c, poses = source.intrinsics, []
    for k, color, depth_mm, T in source:
        yield f"scan/color/{k:06d}.png", png(color)
        yield f"scan/depth/{k:06d}.png", png(depth_mm)
        poses.append(f"{k} {pose_text(T)}\n")
    yield "scan/poses.txt", "".join(poses).encode()
    camera = {name: getattr(c, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    yield "scan/camera.json", json.dumps(camera | {"depth_units_per_metre": 1000}).encode()


def write_tar(source: Source, folder: Path, ballast: int) -> Path:
    """A tar; beside each image lies a file that is a hole."""
    path = folder / "recording.tar"
    with path.open("wb") as file, tarfile.open(fileobj=file, mode="w") as tar:
        for k, (name, data) in enumerate(plain_files(source)):
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
            if k % 2:
                info = tarfile.TarInfo(f"scan/other/{k:06d}.bin")
                info.size = ballast // 512 * 512
                tar.addfile(info)
                file.seek(info.size, io.SEEK_CUR)
                tar.offset += info.size
    return path


def write_zip(source: Source, folder: Path, ballast: int) -> Path:
    """A zip, nothing in it compressed again."""
    path, nothing = folder / "recording.zip", bytes(ballast)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for k, (name, data) in enumerate(plain_files(source)):
            archive.writestr(name, data)
            if k % 2:
                archive.writestr(f"scan/other/{k:06d}.bin", nothing)
    return path


def write_mkv(source: Source, folder: Path, ballast: int) -> Path:
    """A recording of an Azure Kinect with infrared images; the frames are in a corner of its images."""
    import av

    c, path = source.intrinsics, folder / "recording.mkv"
    cameras = []
    for purpose, (width, height), (left, top) in (
        ("PhotoVideo", (1280, 960), (0, 120)),
        ("Depth", (1024, 1024), (0, 0)),
    ):
        fractions = [(c.cx + left + 0.5) / width, (c.cy + top + 0.5) / height, c.fx / width, c.fy / height, *[0.0] * 10]
        place = {"Rotation": np.eye(3).ravel().tolist(), "Translation": [0.0, 0.0, 0.0]}
        name = f"CALIBRATION_CameraPurpose{purpose}"
        cameras.append({"Purpose": name, "Intrinsics": {"ModelParameters": fractions}, "Rt": place})
    calibration = json.dumps({"CalibrationInformation": {"Cameras": cameras}}).encode()
    side = max(2, int((ballast / 2) ** 0.5) // 2 * 2)
    forms = {
        "COLOR": ("mjpeg", (1280, 720), "yuvj422p", "rgb24"),
        "DEPTH": ("rawvideo", (1024, 1024), "gray16be", "gray16le"),
        "IR": ("rawvideo", (side, side), "gray16be", "gray16le"),
    }
    with av.open(str(path), "w", "matroska", options={"allow_raw_vfw": "1"}) as file:
        streams = {}
        for name, (codec, (width, height), pixels, _) in forms.items():
            streams[name] = stream = file.add_stream(codec, rate=30, width=width, height=height, pix_fmt=pixels)
            stream.metadata["title"] = name
            stream.time_base = stream.codec_context.time_base = Fraction(1, 1_000_000)
        file.add_attachment("calibration.json", "application/json", calibration)
        images = {"COLOR": np.zeros((720, 1280, 3), np.uint8), "DEPTH": np.zeros((1024, 1024), np.uint16)}
        images["IR"] = np.zeros((side, side), np.uint16)
        for k, color, depth_mm, _ in source:
            images["COLOR"][: c.height, : c.width] = color
            images["DEPTH"][: c.height, : c.width] = depth_mm
            for name, stream in streams.items():
                frame = av.VideoFrame.from_ndarray(images[name], format=forms[name][3])
                frame.pts, frame.time_base = k * STEP_NS // 1000, Fraction(1, 1_000_000)
                file.mux(stream.encode(frame))
        for stream in streams.values():
            file.mux(stream.encode())
    return path


def _rosbag(kind: str) -> Callable[[Source, Path, int], Path]:
    return lambda source, folder, ballast: write_rosbag(kind, source, folder, ballast)


KINDS: dict[str, Callable[[Source, Path, int], Path]] = {
    **{kind: _rosbag(kind) for kind in ROSBAGS},
    "mkv": write_mkv,
    "sens": write_sens,
    "zip": write_zip,
    "tar": write_tar,
}


def held_mb() -> float:
    """Return the memory that this process holds and no file backs, MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) / 1024
    raise OSError("the system does not say how much memory a process holds")


def measure(path: Path, poses: Path) -> dict[str, Any]:
    """Open a container and track it, in this process; poses are taken from beside where it has none."""
    from cuboid.ground.core.threads import limit_threads
    from cuboid.runs.tracking.posed_tracker import PosedTracker

    limit_threads(1)
    known = np.load(poses)
    begun_s = time.perf_counter()
    recording = open_recording(path)
    open_s = time.perf_counter() - begun_s
    tracker, times = PosedTracker(recording.intrinsics), []
    at = {int(part * len(recording)) - 1: part for part in PARTS}
    found: dict[str, Any] = {"frames": len(recording), "open_s": open_s, "start_mb": held_mb(), "mb": {}}
    for item in recording.iterate():
        if not isinstance(item, Frame):
            raise SystemExit(f"{path}: frame {item.index}: {item.reason}")
        T = item.T_world_camera if item.T_world_camera is not None else known[item.index]
        begun_s = time.perf_counter()
        tracker.update(Frame(item.index, item.timestamp_s, item.color, item.depth_m, T))
        times.append(time.perf_counter() - begun_s)
        if item.index in at:
            found["mb"][str(at[item.index])] = held_mb()
    return found | {"frame_ms": 1e3 * float(np.median(times)), "objects": len(tracker.objects)}


def _forget(file: Path) -> None:
    """Let the system drop what it keeps of a file that was just written, so that it is read from the disk."""
    with file.open("rb+") as opened:
        os.fsync(opened.fileno())
        os.posix_fadvise(opened.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def bench(kind: str, source: Source, parent: Path | None, gigabytes: float) -> dict[str, Any]:
    """Write one container, measure it in another process, and remove it."""
    ballast = max(MIN_BALLAST, int(gigabytes * 1e9 / source.count))
    with tempfile.TemporaryDirectory(prefix="cuboid-containers-", dir=parent) as name:
        folder = Path(name)
        path = KINDS[kind](source, folder, ballast)
        np.save(folder / "poses.npy", np.array([T for *_, T in source]))
        files = [path] if path.is_file() else sorted(path.iterdir())
        sizes = [file.stat() for file in files]
        for file in files:
            _forget(file)
        words = [sys.executable, __file__, "--measure", str(path), str(folder / "poses.npy")]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{kind}: {done.stderr.strip()}")
        found: dict[str, Any] = json.loads(done.stdout)
    gb = sum(size.st_size for size in sizes) / 1e9
    return {"kind": kind, "gb": gb, "disk_gb": sum(512 * size.st_blocks for size in sizes) / 1e9} | found


def main() -> int:
    """Run it."""
    if sys.argv[1:2] == ["--measure"]:
        dump(measure(*map(Path, sys.argv[2:4])))
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", metavar="RECORDING")
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)} (default: all)")
    parser.add_argument("--gigabytes", type=float, default=10.0, help="of a container (default: %(default)s)")
    parser.add_argument("--frames", type=int, default=1000, help="in a container (default: %(default)s)")
    parser.add_argument("--folder", type=Path, help="where containers are made (default: the temporary folder)")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    for kind in args.kinds:
        if kind not in KINDS:
            parser.error(f"unknown kind '{kind}'; there are {', '.join(KINDS)}")
    free_gb = shutil.disk_usage(args.folder or tempfile.gettempdir()).free / 1e9
    if free_gb < 1.5 * args.gigabytes:
        parser.error(f"{free_gb:.0f} GB are free, {1.5 * args.gigabytes:.0f} are needed")
    try:
        source = Source(open_recording(args.recording), args.frames)
    except CuboidError as error:
        parser.error(str(error))
    found = [bench(kind, source, args.folder, args.gigabytes) for kind in args.kinds or KINDS]
    if args.json:
        dump(found)
        return 0
    rows = []
    for one in found:
        sizes = (f"{one['gb']:.2f}", f"{one['disk_gb']:.2f}", one["frames"], f"{one['open_s']:.2f}")
        memory = (one["start_mb"], *one["mb"].values(), one["frame_ms"])
        rows.append((one["kind"], *sizes, *(f"{value:.0f}" for value in memory)))
    show(f"{args.recording}, {args.frames} frames in {args.gigabytes:g} GB", HEADER, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
