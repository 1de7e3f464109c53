"""Camera poses from the video alone: dense odometry, keyframes, loop closure, a graph of poses."""

from __future__ import annotations

from cuboid.poses.drift import DriftCorrection
from cuboid.poses.estimator import PoseEstimate, PoseEstimator

__all__ = ["DriftCorrection", "PoseEstimate", "PoseEstimator"]
