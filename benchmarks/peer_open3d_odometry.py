"""Open3D's RGB-D odometry with no part of this project: run it in an environment of its own.

python benchmarks/peer_open3d_odometry.py WIDTH HEIGHT FX FY CX CY [--keyframes]

Frames come on standard input, each as color (HEIGHT, WIDTH, 3) uint8 RGB and depth (HEIGHT, WIDTH) float32 in metres.
For each a line goes to standard output: T_world_camera, 16 numbers row by row, and milliseconds of processor time.
Color and depth are aligned together (`RGBDOdometryJacobianFromHybridTerm`: Park, Zhou, Koltun, ICCV 2017) with the
settings that Open3D comes with; the motion to begin with is that of the frame before.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
import open3d as o3d

from following import Follower

# Beyond this, metres, the depth of these cameras is left out.
MAX_DEPTH_M = 6.0


def main() -> None:
    """Follow the camera until the frames end."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("size", nargs=2, type=int)
    parser.add_argument("pinhole", nargs=4, type=float)
    parser.add_argument("--keyframes", action="store_true", help="align to keyframes, not to the frame before")
    args = parser.parse_args()
    width, height = args.size
    camera = o3d.camera.PinholeCameraIntrinsic(width, height, *args.pinhole)
    term = o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm()

    def align(reference: o3d.geometry.RGBDImage, frame: o3d.geometry.RGBDImage, T: np.ndarray) -> np.ndarray | None:
        done, found, _ = o3d.pipelines.odometry.compute_rgbd_odometry(frame, reference, camera, T, term)
        return np.asarray(found) if done else None

    follower = Follower(align, args.keyframes)
    while len(data := sys.stdin.buffer.read(width * height * 7)) == width * height * 7:
        color = np.frombuffer(data, np.uint8, width * height * 3).reshape(height, width, 3)
        depth = np.frombuffer(data, np.float32, width * height, width * height * 3).reshape(height, width)
        begun = time.process_time()
        frame = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(color.copy()), o3d.geometry.Image(depth.copy()), 1.0, MAX_DEPTH_M
        )
        T = follower.add(frame)
        print(*T.ravel(), 1e3 * (time.process_time() - begun), flush=True)


if __name__ == "__main__":
    main()
