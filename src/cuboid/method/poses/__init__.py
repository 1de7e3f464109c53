"""Camera poses: dense odometry, keyframes, loop closure and a graph of poses; sources of poses for a run."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cuboid.method.poses.drift import DriftCorrection
    from cuboid.method.poses.estimator import PoseEstimate, PoseEstimator

__all__ = ["DriftCorrection", "PoseEstimate", "PoseEstimator"]

# Modules of the names; imported on demand, because given poses do not need the kernels of alignment.
_PLACES = {
    "DriftCorrection": "cuboid.method.poses.drift",
    "PoseEstimate": "cuboid.method.poses.estimator",
    "PoseEstimator": "cuboid.method.poses.estimator",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'cuboid.method.poses' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return value
