"""Extrinsics of fixed cameras from the scene that they see: planes and heights for the start, depth for the rest.

Each camera gives one still view. Of several candidates for the poses of two views, the one counts that most readings of
the other camera confirm and that fewest contradict. The alignment of all views together gives the final poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry.se3 import angle, inverse
from cuboid.inputs.calibration.chain import chained
from cuboid.inputs.calibration.rig_alignment import FEW_POINTS, REACHES_M, align
from cuboid.inputs.calibration.rig_candidates import agreement, candidates, score
from cuboid.inputs.calibration.still_view import StillView

# Points of a view that are paired for the result; `FEW_POINTS` for candidates.
MANY_POINTS = 40_000
# Two cameras see the same scene if this number of points is confirmed.
MIN_CONFIRMED = 300


@dataclass(frozen=True, slots=True)
class RigFit:
    """The poses of the cameras.

    Attributes
    ----------
    T_rig_camera : (N, 4, 4) float64
        The first camera is the rig.
    error_m, error_rad : (N,) float64
        Standard errors of position and direction, from two halves of the scene; 0 for the first camera.
    confirmed : (N,) int64
        Number of points of other cameras that each camera confirms.
    """

    T_rig_camera: Float64Array
    error_m: Float64Array
    error_rad: Float64Array
    confirmed: npt.NDArray[np.int64]


def fit_rig(views: Sequence[StillView], names: Sequence[str]) -> RigFit:
    """Find the poses of fixed cameras that look at one scene.

    Parameters
    ----------
    views : sequence of StillView
    names : sequence of str
        Names of the cameras, for messages.

    Raises
    ------
    InputError
        A camera sees nothing that another one sees as well.
    """
    start = chained(
        names,
        lambda a, b: _places(views[a], views[b]),
        "no other camera sees the same surfaces; put some objects of different heights where two cameras see them",
    )
    poses = align(views, start, REACHES_M, MANY_POINTS)
    halves = [align(views, poses, REACHES_M[-2:], MANY_POINTS, half) for half in (0, 1)]
    apart = [inverse(one) @ other for one, other in zip(*halves, strict=True)]
    return RigFit(
        poses,
        np.array([np.linalg.norm(T[:3, 3]) / 2 for T in apart]),
        np.array([angle(T) / 2 for T in apart]),
        np.array([_confirmations(views, poses, k) for k in range(len(views))]),
    )


def _places(one: StillView, other: StillView) -> list[tuple[float, Float64Array]]:
    """Return the likely T_one_other (4, 4) with their scores; none if the views do not show the same."""
    found = []
    for start in candidates(one, other):
        T = align([one, other], np.array([np.eye(4), start]), REACHES_M[:2], FEW_POINTS)[1]
        found.append((score(one, other, T), T))
    return [(scored, T) for scored, T in found if scored > MIN_CONFIRMED]


def _confirmations(views: Sequence[StillView], poses: Float64Array, k: int) -> int:
    return sum(agreement(views[k], views[j], inverse(poses[k]) @ poses[j])[0] for j in range(len(views)) if j != k)
