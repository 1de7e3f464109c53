"""The stages of a frame made of what Open3D or OpenCV offers, with no part of this project; see `stages.py`.

python benchmarks/peer_stages.py {open3d,opencv} WIDTH HEIGHT FX FY CX CY VOXEL_M

Frames come on standard input: color (HEIGHT, WIDTH, 3) uint8 RGB, depth (HEIGHT, WIDTH) float32 in metres, and
T_world_camera (4, 4) float64. For each a line of JSON goes to standard output: milliseconds of processor time by stage,
and what came out.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from following import Follower

# As in `peer_open3d.py`.
MAX_DEPTH_M = 3.5
# The surface is stored within so many voxels of a reading.
TRUNCATION_VOXELS = 3.0
# Segments with fewer pixels are part of a neighbour: about 1 cm at 1 m for the images of `stages.py`.
MIN_SEGMENT_PX = 30


class Timed:
    """Processor time of the stages of one frame, and what came out of them."""

    def __init__(self) -> None:
        self.found: dict[str, Any] = {}

    def run(self, stage: str, work: Callable[[], Any]) -> Any:
        """Do the work of a stage."""
        begun = time.process_time()
        result = work()
        self.found[stage] = 1e3 * (time.process_time() - begun)
        return result


class Open3D:
    """Planes, clusters and boxes of `peer_open3d.py`; RGB-D odometry to keyframes; a block grid with distances."""

    def __init__(self, size: tuple[int, int], K: np.ndarray, voxel_m: float) -> None:
        import open3d as o3d

        import peer_open3d

        o3d.utility.random.seed(1)
        o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
        self._o3d, self._voxel_m, self._pipeline = o3d, voxel_m, peer_open3d.Pipeline()
        self._camera = o3d.camera.PinholeCameraIntrinsic(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        self._K = o3d.core.Tensor(K.astype(np.float64))
        term, odometry = o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm(), o3d.pipelines.odometry

        def align(reference: Any, frame: Any, T: np.ndarray) -> np.ndarray | None:
            done, found, _ = odometry.compute_rgbd_odometry(frame, reference, self._camera, T, term)
            return np.asarray(found) if done else None

        self._follower = Follower(align, keyframes=True)
        types = o3d.core.float32, o3d.core.float32, o3d.core.float32
        self._volume = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color"), types, ((1), (1), (3)), voxel_m, 16, 50_000, o3d.core.Device("CPU:0")
        )

    def stages(self, color: np.ndarray, depth_m: np.ndarray, T_world_camera: np.ndarray) -> dict[str, Any]:
        """Run all stages on a frame."""
        o3d, timed = self._o3d, Timed()
        image = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(color), o3d.geometry.Image(depth_m), 1.0, MAX_DEPTH_M
        )
        T = timed.run("odometry", lambda: self._follower.add(image))
        found = timed.run("proposals", lambda: self._find(depth_m, T_world_camera))
        things = timed.run("objects", lambda: self._pipeline.add(found))
        timed.run("fusion", lambda: self._integrate(color, depth_m, T_world_camera))
        timed.found["whole, given poses"] = timed.found["proposals"] + timed.found["objects"]
        timed.found["whole, own poses"] = timed.found["whole, given poses"] + timed.found["odometry"]
        return {**timed.found, "count": len(found), "labels": [one.label for one in things], "T": T.tolist()}

    def _find(self, depth_m: np.ndarray, T_world_camera: np.ndarray) -> list[tuple]:
        image = self._o3d.geometry.Image(depth_m)
        cloud = self._o3d.geometry.PointCloud.create_from_depth_image(
            image, self._camera, depth_scale=1.0, depth_trunc=MAX_DEPTH_M
        )
        points = np.asarray(cloud.transform(T_world_camera).voxel_down_sample(self._voxel_m).points)
        return self._pipeline.find(points, T_world_camera)

    def _integrate(self, color: np.ndarray, depth_m: np.ndarray, T_world_camera: np.ndarray) -> None:
        o3d, K = self._o3d, self._K
        depth = o3d.t.geometry.Image(o3d.core.Tensor(depth_m))
        image = o3d.t.geometry.Image(o3d.core.Tensor(color.astype(np.float32) / 255.0))
        T = o3d.core.Tensor(np.linalg.inv(T_world_camera))
        limits = 1.0, MAX_DEPTH_M, TRUNCATION_VOXELS
        blocks = self._volume.compute_unique_block_coordinates(depth, K, T, *limits)
        self._volume.integrate(blocks, depth, image, K, K, T, *limits)


class OpenCV:
    """Graph segmentation (Felzenszwalb, Huttenlocher, IJCV 2004); `cv2.Odometry` to the frame before; a hashed volume.

    The whole frame is these parts one after the other: OpenCV's own pipeline (KinectFusion) is not in its packages.
    """

    def __init__(self, size: tuple[int, int], K: np.ndarray, voxel_m: float) -> None:
        cv2.setNumThreads(1)
        self._segmentation = cv2.ximgproc.segmentation.createGraphSegmentation(min_size=MIN_SEGMENT_PX)
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(K.astype(np.float32))
        odometry = cv2.Odometry(cv2.ODOMETRY_TYPE_RGB_DEPTH, settings, cv2.ODOMETRY_ALGO_TYPE_COMMON)

        def align(reference: Any, frame: Any, T: np.ndarray) -> np.ndarray | None:
            done, found = odometry.compute(frame, reference, T.copy())
            return np.asarray(found) if done and np.isfinite(found).all() else None

        self._odometry, self._follower = odometry, Follower(align, keyframes=False)
        self._volume = cv2.Volume(cv2.VolumeType_HashTSDF, self._volume_settings(size, K, voxel_m))

    @staticmethod
    def _volume_settings(size: tuple[int, int], K: np.ndarray, voxel_m: float) -> Any:
        settings = cv2.VolumeSettings(cv2.VolumeType_HashTSDF)
        settings.setCameraIntegrateIntrinsics(K.astype(np.float32))
        settings.setIntegrateWidth(size[0])
        settings.setIntegrateHeight(size[1])
        settings.setDepthFactor(1.0)
        settings.setVoxelSize(voxel_m)
        settings.setTsdfTruncateDistance(TRUNCATION_VOXELS * voxel_m)
        settings.setMaxDepth(MAX_DEPTH_M)
        return settings

    def stages(self, color: np.ndarray, depth_m: np.ndarray, T_world_camera: np.ndarray) -> dict[str, Any]:
        """Run all stages on a frame."""
        timed, bgr = Timed(), cv2.cvtColor(color, cv2.COLOR_RGB2BGR)
        segments = timed.run("proposals", lambda: self._segmentation.processImage(bgr))
        T = timed.run("odometry", lambda: self._pose(bgr, depth_m))
        timed.run("fusion", lambda: self._volume.integrate(depth_m, T_world_camera.astype(np.float32)))
        timed.found["whole, given poses"] = timed.found["proposals"] + timed.found["fusion"]
        timed.found["whole, own poses"] = timed.found["whole, given poses"] + timed.found["odometry"]
        return {**timed.found, "count": int(segments.max()) + 1, "T": T.tolist()}

    def _pose(self, bgr: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
        image = cv2.OdometryFrame(depth_m, bgr)
        self._odometry.prepareFrame(image)
        return self._follower.add(image)


def main() -> None:
    """Run the stages until the frames end."""
    name, *numbers = sys.argv[1:]
    width, height = map(int, numbers[:2])
    fx, fy, cx, cy, voxel_m = map(float, numbers[2:])
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    peer = {"open3d": Open3D, "opencv": OpenCV}[name]((width, height), K, voxel_m)
    pixels = width * height
    while len(data := sys.stdin.buffer.read(7 * pixels + 128)) == 7 * pixels + 128:
        color = np.frombuffer(data, np.uint8, 3 * pixels).reshape(height, width, 3).copy()
        depth_m = np.frombuffer(data, np.float32, pixels, 3 * pixels).reshape(height, width).copy()
        T_world_camera = np.frombuffer(data, np.float64, 16, 7 * pixels).reshape(4, 4).copy()
        print(json.dumps(peer.stages(color, depth_m, T_world_camera)), flush=True)


if __name__ == "__main__":
    main()
