"""Estimation of the pinhole with the best agreement of views, for approximate poses.

Gauss-Newton on the residuals of depth and brightness in all pairs, with the weights of a t-distribution. The relative
pose of each pair is corrected as well, with a prior that is a t-distribution too. The width of this prior is estimated
from the corrections (empirical Bayes), so that exact poses are trusted and drifting ones are not. Poses that were
estimated with a wrong pinhole are consistent with it and would be trusted; so estimated poses are never trusted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3
from cuboid.inputs.calibration.comparing import (
    CENTER_X,
    CENTER_Y,
    DEPTH,
    FOCAL,
    MOTION,
    PARAMETERS,
    Warped,
    disagreements,
    warp,
)
from cuboid.inputs.calibration.pairs import relative
from cuboid.inputs.calibration.views import GRADIENT_CELL_PX, ScaledPinhole, View

# Degrees of freedom of the t-distributions: heavy tails, as in Kerl, Sturm, Cremers (IROS 2013).
NU = 5.0
# Errors of neighbouring pixels are correlated: a patch with this side, pixels of the recording, counts as one sample.
CORRELATED_PX = 64.0
# Initial, minimum (that of a file with 4 digits) and maximum error of a relative pose, metres and radians.
POSE_ERROR = np.array([0.01, np.radians(0.5)])
MIN_POSE_ERROR = np.array([0.0003, np.radians(0.01)])
MAX_POSE_ERROR = np.array([0.05, np.radians(2.0)])
# The prior: the focal length within 30 %, the optical centre within 5 % of the image's width, the depth
# scale within 5 %.
FOCAL_FRACTION, CENTER_FRACTION, DEPTH_FRACTION = 0.3, 0.05, 0.05
# Convergence: a step changes focal length and depth scale by less than this fraction, and the centre by less than this
# fraction of the width.
SMALL_STEP = 1e-4
# Scales of the robust loss for comparing (not fitting) agreement, at which a residual counts half: standard deviations
# of depth noise, and contrast (a third of a full step).
DEPTH_SCALE, CONTRAST_SCALE = 2.0, 0.5
# Minimum spread of residuals; it avoids division by zero for noise-free synthetic images.
MIN_SPREAD = 1e-3
# Number of parts, by time, into which the pairs are divided for the jackknife.
PARTS = 8


@dataclass(frozen=True, slots=True)
class Solution:
    """A pinhole with its standard errors.

    Attributes
    ----------
    pinhole : ScaledPinhole
        Pinhole of the recording's images.
    error : (4,) float64
        Standard errors in the parameter order of `comparing`; NaN for parameters that were not fitted.
    pose_error : (2,) float64
        Error of a relative pose, metres and radians.
    disagreement : float
        As `Problem.disagreement`, but with corrected poses.
    """

    pinhole: ScaledPinhole
    error: Float64Array
    pose_error: Float64Array
    disagreement: float


class Problem:
    """Views and the pairs to compare; methods take and return pinholes of the recording's images.

    Parameters
    ----------
    views : sequence of View
    pairs : sequence of (int, int)
        Indices of views, from and to.
    factor : int
        Downsampling factor of the views.
    """

    def __init__(self, views: Sequence[View], pairs: Sequence[tuple[int, int]], factor: int) -> None:
        self._factor = factor
        self._correlated = max(1.0, (CORRELATED_PX / (GRADIENT_CELL_PX * factor)) ** 2)
        self._views = views
        self._pairs = pairs
        self._T_given = relative(views, pairs)
        order = np.argsort(np.argsort([views[i].index + views[j].index for i, j in pairs], kind="stable"))
        self._part = order * PARTS // max(len(pairs), 1)

    def disagreement(self, pinhole: ScaledPinhole, every: int = 1) -> float:
        """Return the mean robust disagreement, 0 to 2, of every n-th pair, with uncorrected poses."""
        small = pinhole.resized(self._factor)
        return _disagreement([self._given(k, small) for k in range(0, len(self._pairs), every)])

    def typical_gap_m(self, pinhole: ScaledPinhole) -> float:
        """Return the median absolute difference of depths, metres, with uncorrected poses."""
        small = pinhole.resized(self._factor)
        found = [self._given(k, small) for k in range(len(self._pairs))]
        return float(np.median(np.abs(np.concatenate([item.gap_m for item in found]))))

    def solve(self, start: ScaledPinhole, free: Sequence[int], steps: int, *, trusting: bool = True) -> Solution:
        """Return the pinhole with the best agreement of views, by local search from `start`.

        Parameters
        ----------
        start : ScaledPinhole
        free : sequence of int
            Parameters to fit.
        steps : int
            Maximum number of steps.
        trusting : bool
            Whether consistent poses are trusted; False for poses that were estimated with the pinhole to be checked.
        """
        index = np.array(free, np.intp)
        width = self._views[0].depth_m.shape[1]
        belief = np.array(
            [FOCAL_FRACTION**-2, (CENTER_FRACTION * width) ** -2, (CENTER_FRACTION * width) ** -2, DEPTH_FRACTION**-2]
        )
        small = SMALL_STEP * np.array([1.0, width, width, 1.0])
        begin, theta = start.resized(self._factor), np.zeros(PARAMETERS)
        pose_error = POSE_ERROR if trusting else MAX_POSE_ERROR
        moves = np.zeros((len(self._pairs), MOTION))
        corrections = [np.eye(4)] * len(self._pairs)
        for _ in range(steps):
            normal = self._normal_equations(_moved(begin, theta), corrections, moves, pose_error)
            H = normal.H.sum(0) + np.diag(belief)
            g = normal.g.sum(0) + belief * theta
            step = np.zeros(PARAMETERS)
            step[index] = -np.linalg.solve(H[np.ix_(index, index)], g[index])
            theta += step
            follow = -np.einsum("pij,pj->pi", normal.spread, normal.b + np.einsum("pij,i->pj", normal.cross, step))
            moves += follow
            corrections = [se3.exp(move) @ T for move, T in zip(follow, corrections, strict=True)]
            if trusting:
                pose_error = _pose_error(moves, normal.spread, pose_error)
            if np.all(np.abs(step) < small):
                break
        pinhole = _moved(begin, theta)
        found = _disagreement(self._mended(pinhole, corrections)[1])
        error = self._error(normal, H, g, index) * np.array([1.0, self._factor, self._factor, 1.0])
        return Solution(pinhole.resized(1 / self._factor), error, pose_error, found)

    def _given(self, pair: int, pinhole: ScaledPinhole) -> Warped:
        """Compare two views with uncorrected poses."""
        i, j = self._pairs[pair]
        return warp(self._views[i], self._views[j], _divided(self._T_given[pair], pinhole.depth_scale), pinhole)

    def _mended(
        self, pinhole: ScaledPinhole, corrections: Sequence[Float64Array]
    ) -> tuple[list[Float64Array], list[Warped]]:
        """Return the corrected motion of each pair, and the comparison of its views with it."""
        T = [
            correction @ _divided(given, pinhole.depth_scale)
            for correction, given in zip(corrections, self._T_given, strict=True)
        ]
        pairs = zip(self._pairs, T, strict=True)
        return T, [warp(self._views[i], self._views[j], T_pair, pinhole) for (i, j), T_pair in pairs]

    def _normal_equations(
        self, pinhole: ScaledPinhole, corrections: Sequence[Float64Array], moves: Float64Array, pose_error: Float64Array
    ) -> _Normal:
        """Return the equations of each pair, with the pair's motion eliminated (Schur complement)."""
        T, found = self._mended(pinhole, corrections)
        spreads = (
            _spread(np.concatenate([item.gap_m / item.noise_m for item in found])),
            _spread(np.concatenate([item.change[item.same] for item in found])),
        )
        count = len(T)
        A, a = np.zeros((count, PARAMETERS, PARAMETERS)), np.zeros((count, PARAMETERS))
        C, b = np.zeros((count, MOTION, MOTION)), np.zeros((count, MOTION))
        B = np.zeros((count, PARAMETERS, MOTION))
        for k, (item, T_pair) in enumerate(zip(found, T, strict=True)):
            shift_m = T_pair[:3, 3] - corrections[k][:3, 3]
            for part, spread in zip(disagreements(item, T_pair, pinhole, shift_m), spreads, strict=True):
                weight = (NU + 1) / (NU + (part.residual / spread) ** 2) / (spread**2 * self._correlated)
                weighted = part.by_parameter * weight[:, None]
                A[k] += weighted.T @ part.by_parameter
                a[k] += weighted.T @ part.residual
                B[k] += weighted.T @ part.by_motion
                weighted = part.by_motion * weight[:, None]
                C[k] += weighted.T @ part.by_motion
                b[k] += weighted.T @ part.residual
        trust = np.repeat(pose_error**-2, 3)
        pull = (NU + MOTION) / (NU + (moves**2 * trust).sum(1))
        C += np.diag(trust) * pull[:, None, None]
        b += moves * trust * pull[:, None]
        inverse = np.linalg.inv(C).astype(np.float64)
        H = A - B @ inverse @ B.transpose(0, 2, 1)
        g = a - np.einsum("pij,pj->pi", B @ inverse, b)
        return _Normal(H.astype(np.float64), g, inverse, B, b)

    def _error(self, normal: _Normal, H: Float64Array, g: Float64Array, index: npt.NDArray[np.intp]) -> Float64Array:
        """Return standard errors by the jackknife: leave out each part of the pairs once, one step each."""
        block = np.ix_(index, index)
        shifts = []
        for part in range(PARTS):
            out = self._part == part
            rest_H, rest_g = H - normal.H[out].sum(0), g - normal.g[out].sum(0)
            shifts.append(-np.linalg.solve(rest_H[block], rest_g[index]))
        off = np.array(shifts) - np.mean(shifts, axis=0)
        error = np.full(PARAMETERS, np.nan)
        error[index] = np.sqrt((PARTS - 1) / PARTS * (off**2).sum(0) + np.diag(np.linalg.inv(H[block])))
        return error


@dataclass(frozen=True, slots=True)
class _Normal:
    """Normal equations of P pairs: `spread` is the covariance of a pair's own motion given the parameters."""

    H: Float64Array
    g: Float64Array
    spread: Float64Array
    cross: Float64Array
    b: Float64Array


def _disagreement(found: Sequence[Warped]) -> float:
    depth = np.concatenate([item.gap_m / item.noise_m for item in found])
    change = np.concatenate([item.change[item.same] for item in found])
    return _bounded(depth, DEPTH_SCALE) + _bounded(change, CONTRAST_SCALE)


def _divided(T: Float64Array, depth_scale: float) -> Float64Array:
    """Return a motion (4, 4) in units of the depth as read: the translation is divided by the depth scale."""
    scaled = T.copy()
    scaled[:3, 3] /= depth_scale
    return scaled


def _moved(start: ScaledPinhole, theta: Float64Array) -> ScaledPinhole:
    grown, scaled = np.exp(theta[FOCAL]), np.exp(theta[DEPTH])
    return ScaledPinhole(
        float(start.fx * grown),
        float(start.fy * grown),
        float(start.cx + theta[CENTER_X]),
        float(start.cy + theta[CENTER_Y]),
        float(start.depth_scale * scaled),
    )


def _pose_error(moves: Float64Array, spread: Float64Array, before: Float64Array) -> Float64Array:
    """Return the error of relative poses from their corrections and covariances (one EM step)."""
    trust = np.repeat(before**-2, 3)
    pull = (NU + MOTION) / (NU + (moves**2 * trust).sum(1))
    square = (pull[:, None] * moves**2 + np.diagonal(spread, axis1=1, axis2=2)).mean(0).reshape(2, 3).mean(1)
    error: Float64Array = np.clip(np.sqrt(square), MIN_POSE_ERROR, MAX_POSE_ERROR)
    return error


def _spread(residual: Float64Array) -> float:
    """Return a robust standard deviation of residuals with outliers, from their median absolute value."""
    return max(1.4826 * float(np.median(np.abs(residual))), MIN_SPREAD) if len(residual) else 1.0


def _bounded(residual: Float64Array, scale: float) -> float:
    """Return the mean Geman-McClure loss of residuals, each at most 1 (Geman, McClure 1985)."""
    square = (residual / scale) ** 2
    return float(np.mean(square / (1.0 + square))) if len(residual) else 1.0
