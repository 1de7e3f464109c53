"""The same frames in every container that can be read, each written by its own library where it has one."""

from __future__ import annotations

import json
import shutil
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from made_bags import START_NS, encoded, time_of, writing

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.bonn import SCALE, T_MARKERS_CAMERA, T_ROS

# Camera's axes of ARKit and OpenGL.
TURN = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Frames:
    """What is recorded: color (H, W, 3) RGB, depth (H, W) uint16 in millimetres, T_world_camera; at 30 Hz."""

    camera: Intrinsics
    color: list[np.ndarray]
    depth_mm: list[np.ndarray]
    poses: list[np.ndarray]

    @property
    def K(self) -> tuple[float, float, float, float]:
        c = self.camera
        return c.fx, c.fy, c.cx, c.cy

    @property
    def named(self) -> dict[str, float]:
        c = self.camera
        return {"fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "width": c.width, "height": c.height}

    @property
    def matrix(self) -> np.ndarray:
        fx, fy, cx, cy = self.K
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def put(path: Path, data: bytes | str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)


def xyzw(T: np.ndarray) -> tuple[float, ...]:
    w, x, y, z = (float(v) for v in se3.quat_wxyz_from_rotation(T[:3, :3]))
    return x, y, z, w


def line_of(*values: object) -> str:
    return " ".join(map(str, values)) + "\n"


def rows_of(matrix: np.ndarray) -> str:
    return "".join(line_of(*row.tolist()) for row in matrix)


def images(frames: Frames, color: Callable[[int], Path], depth: Callable[[int], Path], scale: float = 1.0) -> None:
    for k in range(len(frames.color)):
        put(color(k), encoded(color(k).suffix, frames.color[k]))
        put(depth(k), encoded(".png", np.rint(frames.depth_mm[k] * scale).astype(np.uint16)))


def plain(frames: Frames, root: Path, **camera: object) -> Path:
    images(frames, lambda k: root / "color" / f"{k:06d}.png", lambda k: root / "depth" / f"{k:06d}.png")
    put(root / "camera.json", json.dumps(frames.named | {"depth_units_per_metre": 1000} | camera))
    put(root / "timestamps.txt", "".join(f"{k} {k / 30:.6f}\n" for k in range(len(frames.poses))))
    put(root / "poses.txt", "".join(line_of(k, *T[:3, 3], *xyzw(T)) for k, T in enumerate(frames.poses)))
    return root


def tum(frames: Frames, root: Path) -> Path:
    images(frames, lambda k: root / "rgb" / f"{k}.png", lambda k: root / "depth" / f"{k}.png", 5)
    for kind in ("rgb", "depth"):
        put(root / f"{kind}.txt", "".join(f"{k / 30:.6f} {kind}/{k}.png\n" for k in range(len(frames.color))))
    truth = (line_of(f"{k / 30:.6f}", *T[:3, 3], *xyzw(T)) for k, T in enumerate(frames.poses))
    put(root / "groundtruth.txt", "".join(truth))
    put(root / "camera.json", json.dumps(frames.named))
    return root


def bonn(frames: Frames, root: Path) -> Path:
    """The poses are those of the markers on the camera, in the axes of the motion capture."""
    to_markers = np.linalg.inv(T_MARKERS_CAMERA) @ T_ROS
    depth_mm = [np.rint(depth / SCALE).astype(np.uint16) for depth in frames.depth_mm]
    tum(replace(frames, depth_mm=depth_mm, poses=[T_ROS @ T @ to_markers for T in frames.poses]), root)
    (root / "camera.json").unlink()  # its camera is known
    return root.rename(root.with_name("rgbd_bonn_made"))


def icl_nuim(frames: Frames, root: Path) -> Path:
    turn = np.diag([1.0, -1, 1, 1])
    images(frames, lambda k: root / "rgb" / f"{k}.png", lambda k: root / "depth" / f"{k}.png", 5)
    numbers = range(len(frames.color))
    put(root / "associations.txt", "".join(f"{k} depth/{k}.png {k} rgb/{k}.png\n" for k in numbers))
    turned = [turn @ T @ turn for T in frames.poses]
    poses = "".join(line_of(k, *T[:3, 3], *xyzw(T)) for k, T in enumerate(turned))
    put(root / "livingRoom2.gt.freiburg", poses)
    return root


def seven_scenes(frames: Frames, root: Path) -> Path:
    images(frames, lambda k: root / f"frame-{k:06d}.color.png", lambda k: root / f"frame-{k:06d}.depth.png")
    put(root / "camera.json", json.dumps(frames.named))
    for k, T in enumerate(frames.poses):
        put(root / f"frame-{k:06d}.pose.txt", rows_of(T))
    return root


def uw(frames: Frames, root: Path) -> Path:
    scene = root / "imgs" / "scene_01"
    images(frames, lambda k: scene / f"{k:05d}-color.png", lambda k: scene / f"{k:05d}-depth.png", 10)
    put(scene / "camera.json", json.dumps(frames.named))
    lines = (line_of(xyzw(T)[3], *xyzw(T)[:3], *T[:3, 3]) for T in frames.poses)
    put(root / "pc" / "01.pose", "".join(lines))
    return root


def open3d(frames: Frames, root: Path) -> Path:
    images(frames, lambda k: root / "color" / f"{k:06d}.png", lambda k: root / "depth" / f"{k:06d}.png")
    size = {"width": frames.camera.width, "height": frames.camera.height}
    put(root / "camera_intrinsic.json", json.dumps(size | {"intrinsic_matrix": frames.matrix.T.ravel().tolist()}))
    put(root / "trajectory.log", "".join(line_of(k, k, k + 1) + rows_of(T) for k, T in enumerate(frames.poses)))
    return root


def replica(frames: Frames, root: Path) -> Path:
    results = root / "office0" / "results"
    images(frames, lambda k: results / f"frame{k:06d}.png", lambda k: results / f"depth{k:06d}.png", 5)
    put(root / "office0" / "traj.txt", "".join(line_of(*T.ravel().tolist()) for T in frames.poses))
    fx, fy, cx, cy = frames.K
    camera = {"w": frames.camera.width, "h": frames.camera.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    put(root / "cam_params.json", json.dumps({"camera": camera | {"scale": 5000}}))
    return root


def homogeneous(matrix: np.ndarray) -> np.ndarray:
    whole = np.eye(4)
    whole[:3, :3] = matrix
    return whole


def scannet(frames: Frames, root: Path) -> Path:
    images(frames, lambda k: root / "color" / f"{k}.png", lambda k: root / "depth" / f"{k}.png")
    for k, T in enumerate(frames.poses):
        put(root / "pose" / f"{k}.txt", rows_of(T))
    for name in ("color", "depth"):
        put(root / "intrinsic" / f"intrinsic_{name}.txt", rows_of(homogeneous(frames.matrix)))
    return root


def sens(frames: Frames, root: Path) -> Path:
    c, K = frames.camera, homogeneous(frames.matrix).astype("<f4").tobytes()
    eye = np.eye(4, dtype="<f4").tobytes()
    data = struct.pack("<IQ", 4, 4) + b"made" + K + eye + K + eye
    size = (c.width, c.height)
    data += struct.pack("<iiIIIIfQ", 1, 1, *size, *size, 1000.0, len(frames.color))
    for k, T in enumerate(frames.poses):
        color, depth = encoded(".png", frames.color[k]), zlib.compress(frames.depth_mm[k].tobytes())
        times = 33_333 * k
        data += T.astype("<f4").tobytes() + struct.pack("<QQQQ", times, times, len(color), len(depth)) + color + depth
    put(root / "scene.sens", data)
    return root / "scene.sens"


def bop(frames: Frames, root: Path) -> Path:
    images(frames, lambda k: root / "rgb" / f"{k:06d}.png", lambda k: root / "depth" / f"{k:06d}.png", 10)
    cameras = {}
    for k, T in enumerate(np.linalg.inv(np.array(frames.poses))):
        pose = {"cam_R_w2c": T[:3, :3].ravel().tolist(), "cam_t_w2c": (1000 * T[:3, 3]).tolist()}
        cameras[str(k)] = {"cam_K": frames.matrix.ravel().tolist(), "depth_scale": 0.1} | pose
    put(root / "scene_camera.json", json.dumps(cameras))
    return root


def nerfstudio(frames: Frames, root: Path) -> Path:
    images(frames, lambda k: root / "images" / f"{k}.png", lambda k: root / "depth" / f"{k}.png")
    fx, fy, cx, cy = frames.K
    camera = {"fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5, "w": frames.camera.width}
    listed = [
        {"file_path": f"images/{k}.png", "depth_file_path": f"depth/{k}.png", "transform_matrix": (T @ TURN).tolist()}
        for k, T in enumerate(frames.poses)
    ]
    document = camera | {"h": frames.camera.height, "frames": listed[::-1]}  # in any order
    put(root / "transforms.json", json.dumps(document))
    return root


def sun3d(frames: Frames, root: Path) -> Path:
    for k, color in enumerate(frames.color):
        name, raw = f"{k + 1:07d}-{33_333 * k:012d}", frames.depth_mm[k]
        put(root / "image" / f"{name}.png", encoded(".png", color))
        put(root / "depth" / f"{name}.png", encoded(".png", (raw << 3) | (raw >> 13)))
    put(root / "intrinsics.txt", rows_of(frames.matrix))
    put(root / "extrinsics" / "20140909.txt", "".join(rows_of(T[:3]) for T in frames.poses))
    return root


def netpbm(image: np.ndarray) -> bytes:
    kind, largest = ("P6", 255) if image.ndim == 3 else ("P5", 65535)
    head = f"{kind}\n{image.shape[1]} {image.shape[0]}\n{largest}\n".encode()
    return head + (image if image.ndim == 3 else image.astype(">u2")).tobytes()


def three_rscan(frames: Frames, root: Path) -> Path:
    for k, T in enumerate(frames.poses):
        put(root / f"frame-{k:06d}.color.png", encoded(".png", frames.color[k]))
        put(root / f"frame-{k:06d}.depth.pgm", netpbm(frames.depth_mm[k]))
        put(root / f"frame-{k:06d}.pose.txt", rows_of(T))
    values = {"m_depthShift": 1000}
    for name in ("color", "depth"):
        values |= {f"m_{name}Width": frames.camera.width, f"m_{name}Height": frames.camera.height}
        matrix = homogeneous(frames.matrix).ravel().tolist()
        values[f"m_calibration{name.title()}Intrinsic"] = " ".join(map(str, matrix))
    put(root / "_info.txt", "".join(f"{name} = {value}\n" for name, value in values.items()))
    return root


def arkitscenes(frames: Frames, root: Path) -> Path:
    lines = []
    for k, T in enumerate(frames.poses):
        name = f"7_{100 + k / 30:.3f}"
        put(root / "lowres_wide" / f"{name}.png", encoded(".png", frames.color[k]))
        put(root / "lowres_depth" / f"{name}.png", encoded(".png", frames.depth_mm[k]))
        pincam = line_of(frames.camera.width, frames.camera.height, *frames.K)
        put(root / "lowres_wide_intrinsics" / f"{name}.pincam", pincam)
        T_camera_world = np.linalg.inv(T)
        turn = cv2.Rodrigues(T_camera_world[:3, :3])[0].ravel().tolist()
        lines.append(line_of(f"{100 + k / 30:.3f}", *turn, *T_camera_world[:3, 3]))
    put(root / "lowres_wide.traj", "".join(lines))
    return root


def infinitam(frames: Frames, root: Path) -> Path:
    for k, color in enumerate(frames.color):
        put(root / "Frames" / f"{k:04d}.ppm", netpbm(color))
        put(root / "Frames" / f"{k:04d}.pgm", netpbm(frames.depth_mm[k]))
    camera = line_of(frames.camera.width, frames.camera.height, *frames.K)
    put(root / "calib.txt", camera + camera + rows_of(np.eye(4)[:3]) + "affine 0.001 0\n")
    return root


def record3d_metadata(frames: Frames) -> dict[str, object]:
    poses = [[*xyzw(T @ TURN), *T[:3, 3].tolist()] for T in frames.poses]
    size = {"w": frames.camera.width, "h": frames.camera.height}
    size |= {"dw": frames.camera.width, "dh": frames.camera.height}
    return size | {"K": frames.matrix.T.ravel().tolist(), "poses": poses, "fps": 30}


def record3d(frames: Frames, root: Path) -> Path:
    import OpenEXR

    for k, color in enumerate(frames.color):
        put(root / "rgb" / f"{k}.png", encoded(".png", color))
        (root / "depth").mkdir(exist_ok=True)
        depth_m = frames.depth_mm[k].astype(np.float32) / np.float32(1000)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"R": depth_m}) as file:
            file.write(str(root / "depth" / f"{k}.exr"))
    put(root / "metadata.json", json.dumps(record3d_metadata(frames)))
    return root


def record3d_file(frames: Frames, root: Path) -> Path:
    import liblzfse

    root.mkdir(parents=True)
    with zipfile.ZipFile(root / "a.r3d", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("metadata", json.dumps(record3d_metadata(frames)))
        for k, color in enumerate(frames.color):
            depth_m = frames.depth_mm[k].astype(np.float32) / np.float32(1000)
            archive.writestr(f"rgbd/{k}.jpg", encoded(".jpg", color))
            archive.writestr(f"rgbd/{k}.depth", liblzfse.compress(depth_m.tobytes()))
    return root / "a.r3d"


def polycam(frames: Frames, root: Path) -> Path:
    keyframes = root / "keyframes"
    images(frames, lambda k: keyframes / "images" / f"{k:08d}.png", lambda k: keyframes / "depth" / f"{k:08d}.png")
    for k, T in enumerate(frames.poses):
        matrix = T @ TURN
        camera = frames.named | {f"t_{r}{c}": matrix[r, c] for r in range(3) for c in range(4)}
        put(keyframes / "cameras" / f"{k:08d}.json", json.dumps(camera | {"timestamp": k / 30}))
    return root


def stray_scanner(frames: Frames, root: Path) -> Path:
    root.mkdir(parents=True)
    with av.open(str(root / "rgb.mp4"), "w") as file:
        stream = file.add_stream("libx264", rate=30, width=frames.camera.width, height=frames.camera.height)
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "10"}
        for color in frames.color:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(color, format="rgb24")))
        file.mux(stream.encode())
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw\n"]
    for k, T in enumerate(frames.poses):
        put(root / "depth" / f"{k:06d}.png", encoded(".png", frames.depth_mm[k]))
        lines.append(", ".join(map(str, (k / 30, k, *T[:3, 3], *xyzw(T)))) + "\n")
    put(root / "odometry.csv", "".join(lines))
    put(root / "camera_matrix.csv", "".join(", ".join(map(str, row)) + "\n" for row in frames.matrix.tolist()))
    return root


def ros(kind: str) -> Callable[[Frames, Path], Path]:
    def write(frames: Frames, root: Path) -> Path:
        root.mkdir(parents=True)
        path = root / (f"a.{kind}" if kind == "bag" else "bag")
        optical = "camera_color_optical_frame"
        with writing(path, kind) as (make, publish):
            publish("/camera/color/camera_info", make.info(frames.named, optical, START_NS), START_NS)
            for k, T in enumerate(frames.poses):
                t = time_of(k)
                publish("/tf", make.transform("world", optical, t, tuple(map(float, T[:3, 3])), xyzw(T)), t)
                publish("/camera/color/image_raw", make.image(frames.color[k], "rgb8", optical, t), t)
                depth = make.image(frames.depth_mm[k], "16UC1", optical, t)
                publish("/camera/aligned_depth_to_color/image_raw", depth, t)
        return path

    return write


def realsense(frames: Frames, root: Path, *, colored: bool = True) -> Path:
    root.mkdir(parents=True)
    with writing(root / "a.bag", "bag") as (make, publish):
        units = make("std_msgs/msg/Float32", data=0.0005)
        publish("/device_0/sensor_0/option/Depth Units/value", units, START_NS)
        for stem in ("/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"):
            publish(f"{stem}/info/camera_info", make.info(frames.named, "", START_NS), START_NS)
        for k, color in enumerate(frames.color):
            t = time_of(k)
            if colored:
                publish("/device_0/sensor_1/Color_0/image/data", make.image(color[..., ::-1], "bgr8", "", t), t)
            depth = make.image(2 * frames.depth_mm[k], "mono16", "", t)
            publish("/device_0/sensor_0/Depth_0/image/data", depth, t)
    return root / "a.bag"


def azure_kinect(frames: Frames, root: Path, *, calibration: str | None = None, lost_depth: int | None = None) -> Path:
    root.mkdir(parents=True)
    c, K = frames.camera, tuple(3 * value if k < 2 else 3 * (value + 0.5) - 0.5 for k, value in enumerate(frames.K))
    cameras = [
        kinect_camera("PhotoVideo", K, (1280, 960), (0, 120)),
        kinect_camera("Depth", K, (1024, 1024), (0, 0)),
    ]
    if calibration is None:
        calibration = json.dumps({"CalibrationInformation": {"Cameras": cameras}})
    step_us = 33_333
    with av.open(str(root / "a.mkv"), "w", "matroska", options={"allow_raw_vfw": "1"}) as file:
        color = file.add_stream("mjpeg", rate=30, width=1280, height=720, pix_fmt="yuvj444p")
        color.codec_context.options = {"qmin": "1", "q": "1"}
        depth = file.add_stream("rawvideo", rate=30, width=1024, height=1024, pix_fmt="gray16be")
        for stream, name in ((color, "COLOR"), (depth, "DEPTH")):
            stream.metadata["title"] = name
            stream.time_base = stream.codec_context.time_base = Fraction(1, 1_000_000)
        if calibration:
            file.add_attachment("calibration.json", "application/json", calibration.encode())
        for k, picture in enumerate(frames.color):
            large = np.zeros((720, 1280, 3), np.uint8)
            large[: 3 * c.height, : 3 * c.width] = np.kron(picture, np.ones((3, 3, 1), np.uint8))
            wide = np.zeros((1024, 1024), np.uint16)
            wide[: 3 * c.height, : 3 * c.width] = np.kron(frames.depth_mm[k], np.ones((3, 3), np.uint16))
            for stream, array, form in ((color, large, "rgb24"), (depth, wide, "gray16le"))[: 2 - (k == lost_depth)]:
                frame = av.VideoFrame.from_ndarray(array, format=form)
                frame.pts, frame.time_base = k * step_us, Fraction(1, 1_000_000)
                file.mux(stream.encode(frame))
        for stream in (color, depth):
            file.mux(stream.encode())
    return root / "a.mkv"


def kinect_camera(
    purpose: str, K: tuple[float, ...], sensor: tuple[int, int], corner: tuple[int, int]
) -> dict[str, object]:
    (fx, fy, cx, cy), (width, height), (left, top) = K, sensor, corner
    fractions = [(cx + left + 0.5) / width, (cy + top + 0.5) / height, fx / width, fy / height, *[0.0] * 10]
    rt = {"Rotation": np.eye(3).ravel().tolist(), "Translation": [0.0, 0.0, 0.0]}
    purpose = f"CALIBRATION_CameraPurpose{purpose}"
    return {"Purpose": purpose, "Intrinsics": {"ModelParameters": fractions}, "Rt": rt}


def zipped(frames: Frames, root: Path) -> Path:
    folder = plain(frames, root / "scan")
    with zipfile.ZipFile(root / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*.*")):
            archive.write(file, file.relative_to(root))
    shutil.rmtree(folder)
    return root / "a.zip"


def tarred(frames: Frames, root: Path) -> Path:
    folder = plain(frames, root / "scan")
    with tarfile.open(root / "a.tar", "w") as archive:
        archive.add(folder, "scan")
    shutil.rmtree(folder)
    return root / "a.tar"


# The containers that keep color and depth as they are, and those whose color is a JPEG's or a video's.
LOSSLESS: dict[str, Callable[[Frames, Path], Path]] = {
    "tum": tum,
    "icl-nuim": icl_nuim,
    "7-scenes": seven_scenes,
    "uw-rgbd-scenes-v2": uw,
    "open3d": open3d,
    "replica": replica,
    "scannet": scannet,
    "scannet-sens": sens,
    "bop": bop,
    "nerfstudio": nerfstudio,
    "sun3d": sun3d,
    "3rscan": three_rscan,
    "arkitscenes": arkitscenes,
    "infinitam": infinitam,
    "record3d": record3d,
    "polycam": polycam,
    "ros-bag bag": ros("bag"),
    "ros-bag db3": ros("db3"),
    "ros-bag mcap": ros("mcap"),
    "realsense-bag": realsense,
    "plain zip": zipped,
    "plain tar": tarred,
}
LOSSY: dict[str, Callable[[Frames, Path], Path]] = {
    "record3d-file": record3d_file,
    "stray-scanner": stray_scanner,
    "azure-kinect": azure_kinect,
}
