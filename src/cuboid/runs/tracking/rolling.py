"""Rotation of frames by quarter turns, so that results do not depend on how the camera is rolled.

All images of a recording are rotated by the same number of quarter turns. In the first image, farther surfaces then lie
above nearer ones, as on every surface that is seen from above. A recording with rotated images, intrinsics and poses
then gives identical results.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.core.tolerances import MIN_READINGS
from cuboid.method.detection.types import Detections
from cuboid.method.proposals.types import Proposals

# R_camera_turned of a camera whose image is rotated clockwise by a quarter turn.
QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def farther_up(depth_m: Float32Array) -> int | None:
    """Return the number of clockwise quarter turns, 0..3, after which farther surfaces lie above nearer ones.

    None if there are too few readings.

    Parameters
    ----------
    depth_m : (H, W) float32
        Metres, 0 none.
    """
    v, u = np.nonzero(depth_m > 0)
    if len(v) < MIN_READINGS:
        return None
    near = 1.0 / depth_m[v, u].astype(np.float64)
    # Growth of nearness to the right and downwards. Integers are summed first, because their sums are exact.
    across, down = near @ (len(u) * u - int(u.sum())), near @ (len(v) * v - int(v.sum()))
    # After a clockwise quarter turn, the right side becomes the bottom, and the bottom becomes the left side.
    return int(np.argmax([down, across, -down, -across]))


@dataclass(frozen=True, slots=True)
class Roll:
    """Clockwise quarter turns by which images are rotated before processing.

    Attributes
    ----------
    intrinsics : Intrinsics
        Intrinsics of the unrotated images.
    turns : int
        Number of quarter turns, 0..3.
    """

    intrinsics: Intrinsics
    turns: int

    @property
    def camera(self) -> Intrinsics:
        """Intrinsics of the rotated images."""
        camera = self.intrinsics
        for _ in range(self.turns):
            camera = Intrinsics(
                camera.fy, camera.fx, camera.height - 1 - camera.cy, camera.cx, camera.height, camera.width
            )
        return camera

    def frame(self, frame: Frame) -> Frame:
        """Return a rotated frame, with its pose."""
        if self.turns == 0:
            return frame
        T = frame.T_world_camera
        return dataclasses.replace(
            frame,
            color=np.ascontiguousarray(np.rot90(frame.color, -self.turns)),
            depth_m=np.ascontiguousarray(np.rot90(frame.depth_m, -self.turns)),
            T_world_camera=None if T is None else self.pose(T),
            up_camera=None if frame.up_camera is None else frame.up_camera @ self._rotation(),
        )

    def placed(self, turned: Frame, frame: Frame) -> Frame:
        """Return a rotated frame with the pose that follows from the pose of the unrotated frame."""
        T = frame.T_world_camera
        return frame if self.turns == 0 or T is None else turned.at(self.pose(T))

    def pose(self, T_world_camera: Float64Array) -> Float64Array:
        """Return the pose of the rotated camera, T_world_turned (4, 4)."""
        return _turned(T_world_camera, self._rotation())

    def image_up(self, T_world_camera: Float64Array) -> Float64Array:
        """Return up of the rotated images, (3,) in the world."""
        return np.asarray(-self.pose(T_world_camera)[:3, 1])

    def proposals(self, found: Proposals) -> Proposals:
        """Transform the proposals of an image to the rotated image."""
        if self.turns == 0 or not len(found):
            return found
        masks = found.full_masks()
        return Proposals(
            self._rectangles(found.boxes_xyxy, self.intrinsics, self.turns).astype(np.int32),
            found.scores,
            None if masks is None else tuple(np.ascontiguousarray(np.rot90(mask, -self.turns)) for mask in masks),
        )

    def detections(self, found: Detections) -> Detections:
        """Transform the detections of an image to the rotated image, without masks."""
        boxes = self._rectangles(found.boxes_xyxy, self.intrinsics, self.turns).astype(np.int32)
        return Detections(boxes, found.scores, found.names)

    def result(self, result: FrameResult) -> FrameResult:
        """Transform the result of a rotated frame to the unrotated frame."""
        if self.turns == 0:
            return result
        back, camera = -self.turns % 4, self.camera
        return dataclasses.replace(
            result,
            T_world_camera=_turned(result.T_world_camera, self._rotation().T),
            sightings=tuple(
                dataclasses.replace(one, rect_xyxy=self._rectangles(one.rect_xyxy[None], camera, back)[0])
                for one in result.sightings
            ),
            proposals=tuple(
                dataclasses.replace(one, rect_xyxy=self._rectangles(one.rect_xyxy[None], camera, back)[0])
                for one in result.proposals
            ),
            heat=np.ascontiguousarray(np.rot90(result.heat, self.turns)),
            size=(self.intrinsics.width, self.intrinsics.height),
        )

    def _rotation(self) -> Float64Array:
        return np.asarray(np.linalg.matrix_power(QUARTER, self.turns))

    @staticmethod
    def _rectangles(boxes_xyxy: npt.NDArray[np.generic], camera: Intrinsics, turns: int) -> Float64Array:
        """Transform rectangles (N, 4) of an image to the image rotated clockwise."""
        boxes, width, height = np.asarray(boxes_xyxy, np.float64), camera.width, camera.height
        for _ in range(turns):
            boxes = np.column_stack([height - boxes[:, 3], boxes[:, 0], height - boxes[:, 1], boxes[:, 2]])
            width, height = height, width
        return boxes


def _turned(T_world_camera: Float64Array, R_camera_turned: Float64Array) -> Float64Array:
    T = T_world_camera.copy()
    T[:3, :3] = T_world_camera[:3, :3] @ R_camera_turned
    return T
