"""What any alignment of two RGB-D frames makes of a video: frame by frame, or each frame to a keyframe.

Only numpy is needed, so that a peer with an environment of its own runs the same loop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

# A frame becomes the next keyframe this far from the last one, metres and degrees.
KEYFRAME_M, KEYFRAME_DEG = 0.10, 8.0
# Less would wear the keyframe out by one bad alignment: a jump by more than this from one frame to the next is none.
JUMP_M, JUMP_DEG = 0.30, 30.0

# (keyframe, frame, T_guess) -> T_keyframe_frame, each (4, 4), or None where it fails.
Align = Callable[[Any, Any, np.ndarray], np.ndarray | None]


class Follower:
    """Follows a camera by aligning each frame to one before.

    Parameters
    ----------
    align : callable
    keyframes : bool
        Whether to align to the last keyframe, or else to the frame before.
    """

    def __init__(self, align: Align, keyframes: bool) -> None:
        self._align, self._keyframes = align, keyframes
        self._reference: Any = None
        self._T_world_reference = np.eye(4)
        self._T_reference_last = np.eye(4)
        self.failed = 0

    def add(self, frame: Any) -> np.ndarray:
        """Return T_world_camera (4, 4) of a frame; where the alignment fails, that of the frame before."""
        if self._reference is None:
            self._reference = frame
            return np.eye(4)
        T = self._align(self._reference, frame, self._T_reference_last)
        if T is None or beyond(np.linalg.inv(self._T_reference_last) @ T, JUMP_M, JUMP_DEG):
            self.failed += 1
            T = self._T_reference_last
        self._T_reference_last = T
        T_world_camera = self._T_world_reference @ T
        if not self._keyframes or beyond(T, KEYFRAME_M, KEYFRAME_DEG):
            self._reference, self._T_world_reference, self._T_reference_last = frame, T_world_camera, np.eye(4)
        return T_world_camera


def beyond(T: np.ndarray, metres: float, degrees: float) -> bool:
    """Tell whether a motion (4, 4) is longer, or turns by more."""
    turned = np.degrees(np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1.0, 1.0)))
    return bool(np.linalg.norm(T[:3, 3]) > metres or turned > degrees)
