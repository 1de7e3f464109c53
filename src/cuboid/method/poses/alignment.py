"""Dense alignment: the pose of an image relative to points of other images, from intensity and depth together.

After Kerl, Sturm, Cremers, "Dense Visual SLAM for RGB-D Cameras", IROS 2013: weighted Gauss-Newton over a pyramid,
t-distributed residuals, a motion prior. Two things differ: the depth residual is the distance to the surface along its
normal, and the points may come from several keyframes at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array
from cuboid.ground.core.tolerances import MIN_SIGMA_M
from cuboid.ground.geometry import se3
from cuboid.method.poses.kernels import align as kernel
from cuboid.method.poses.pyramid import PYRAMID_LEVELS, Level

# For each level, finest first: side of the cell that gives one point, half the window of its plane, most iterations.
CELLS = (5, 3, 2, 1)
REACHES = (3, 2, 2, 1)
STEPS = (5, 6, 8, 10)
# A level ends when a step is shorter than this (metres and radians, for each level, finest first).
STILL = (1e-4, 4e-4, 1e-3, 2e-3)
# A reading agrees within GATE_M metres (for each level) plus GATE_DEVIATIONS standard deviations of depth noise.
GATE_M = (0.03, 0.05, 0.10, 0.20)
GATE_DEVIATIONS = 6.0
# Standard deviation of depth: metres, and metres per metre squared (structured light; other sensors are better).
NOISE_PER_M = 1.4e-3
NOISE = np.array([MIN_SIGMA_M, NOISE_PER_M])
MAX_DEPTH_M = 6.0
# An alignment is reliable if enough readings lie on the surfaces, intensities are correlated, there are enough points,
MIN_INLIERS, MIN_CORRELATION, MIN_ALIGNED_POINTS = 0.6, 0.8, 150
# and no direction has a larger standard deviation than this, metres and radians.
MAX_DEVIATION_M, MAX_DEVIATION_RAD = 0.03, 0.02
# Errors of neighbouring pixels are correlated: this many residuals count as one.
CORRELATED_RESIDUALS = 50.0
# Standard deviation in addition to noise: metres, and per metre between the cameras; radians, and per metre.
FLOOR_M, FLOOR_FRACTION, FLOOR_RAD, FLOOR_RAD_PER_M = 0.0005, 0.008, 0.0005, 0.008
# Intensity variance of pure noise, grey levels squared: two uniform images count as correlated.
FLAT = 25.0
# Initial scales of the residuals, and their limits: grey levels, standard deviations. Depth errors are correlated over
# whole surfaces, so that depth residuals have at most half the weight that their noise suggests.
SIGMA_FIRST = (12.0, 2.0)
SIGMA_LOW, SIGMA_HIGH = np.array([2.0, 2.0]), np.array([30.0, 6.0])


@dataclass(frozen=True, slots=True)
class Points:
    """Points of one level, from one image or several.

    Attributes
    ----------
    points, normals : (N, 3) float32
    intensity : (N,) float32
    group : (N,) int32
        The image from which each point comes.
    """

    points: Float32Array
    normals: Float32Array
    intensity: Float32Array
    group: npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference of an alignment: points of all levels, finest first, from several images (groups)."""

    levels: tuple[Points, ...]
    groups: int


@dataclass(frozen=True, slots=True)
class Alignment:
    """A pose and the quality of its fit.

    Attributes
    ----------
    T_camera_reference : (4, 4) float64
    information : (6, 6) float64
        Inverse covariance of a motion (translation, rotation) of the camera frame.
    in_image : float
        Fraction of the reference's points inside the image.
    points : int
        Number of points on a surface that the image shows.
    inliers : float
        Of the points with a reading, fraction whose reading lies on their surface.
    correlation : float
        Correlation of the intensities, -1..1, of the group with the highest one.
    sigma : (2,) float64
        Scale of the residuals: grey levels, standard deviations of depth.
    shade : (G, 2) float64
        Gain and bias of the exposure of each group.
    """

    T_camera_reference: Float64Array
    information: Float64Array
    in_image: float
    points: int
    inliers: float
    correlation: float
    sigma: Float64Array
    shade: Float64Array

    def covariance(self, baseline_m: float = 0.0) -> Float64Array:
        """Return the covariance (6, 6) of a motion (translation, rotation) of the camera frame, metres and radians.

        Parameters
        ----------
        baseline_m : float
            Distance to the image of the points: errors of intrinsics and depth grow with it.
        """
        noise = CORRELATED_RESIDUALS * np.linalg.inv(self.information + np.diag([1.0] * 6))
        floor_m, floor_rad = FLOOR_M + FLOOR_FRACTION * baseline_m, FLOOR_RAD + FLOOR_RAD_PER_M * baseline_m
        return np.asarray(noise + np.diag([floor_m**2] * 3 + [floor_rad**2] * 3))

    @property
    def fit(self) -> float:
        """Agreement of image and reference, 0..1."""
        return self.inliers * max(self.correlation, 0.0)

    @property
    def reliable(self) -> bool:
        """Whether the pose is reliable: image and reference agree and determine all six degrees of freedom."""
        if self.inliers < MIN_INLIERS or self.correlation < MIN_CORRELATION or self.points < MIN_ALIGNED_POINTS:
            return False
        deviation = np.sqrt(self.covariance().diagonal())
        return bool(deviation[:3].max() < MAX_DEVIATION_M and deviation[3:].max() < MAX_DEVIATION_RAD)


def pick(levels: Sequence[Level]) -> Reference:
    """Pick the points of an image to which other images are aligned."""
    picked = []
    for k, level in enumerate(levels):
        height, width = level.image.shape[:2]
        max_points = (height // CELLS[k] + 1) * (width // CELLS[k] + 1)
        points, normals = np.empty((max_points, 3), np.float32), np.empty((max_points, 3), np.float32)
        intensity = np.empty(max_points, np.float32)
        n = kernel.pick_points(
            level.image, level.camera.pinhole, CELLS[k], REACHES[k], MAX_DEPTH_M, NOISE[1], points, normals, intensity
        )
        picked.append(Points(points[:n].copy(), normals[:n].copy(), intensity[:n].copy(), np.zeros(n, np.int32)))
    return Reference(tuple(picked), 1)


def merge(references: Sequence[Reference], T_common: Sequence[Float64Array]) -> Reference:
    """Transform the points of several images to a common frame, by (4, 4) each; each image remains a group."""
    levels = []
    for k in range(PYRAMID_LEVELS):
        parts = [reference.levels[k] for reference in references]
        points = [
            (p.points @ T[:3, :3].T.astype(np.float32) + T[:3, 3].astype(np.float32))
            for p, T in zip(parts, T_common, strict=True)
        ]
        normals = [p.normals @ T[:3, :3].T.astype(np.float32) for p, T in zip(parts, T_common, strict=True)]
        group = [np.full(len(p.points), g, np.int32) for g, p in enumerate(parts)]
        levels.append(
            Points(
                np.concatenate(points),
                np.concatenate(normals),
                np.concatenate([p.intensity for p in parts]),
                np.concatenate(group),
            )
        )
    return Reference(tuple(levels), len(references))


@dataclass(frozen=True, slots=True)
class Prior:
    """The expected pose of the camera.

    Attributes
    ----------
    T_camera_reference : (4, 4) float64
    information : (6, 6) float64
        Inverse covariance of a motion of the camera frame from the expected pose.
    """

    T_camera_reference: Float64Array
    information: Float64Array


def align(
    reference: Reference,
    levels: Sequence[Level],
    T_camera_reference: Float64Array,
    prior: Prior | None = None,
    coarsest: int = PYRAMID_LEVELS - 1,
    finest: int = 0,
) -> Alignment:
    """Find the pose of an image relative to a reference.

    Parameters
    ----------
    reference : Reference
    levels : sequence of Level
        The image, finest first.
    T_camera_reference : (4, 4) float64
        Initial pose.
    prior : Prior, optional
    coarsest, finest : int
        Levels at which the search starts and ends.
    """
    T = T_camera_reference
    sigma = np.array(SIGMA_FIRST)
    shade = np.tile([1.0, 0.0], (reference.groups, 1))
    for k in range(coarsest, finest - 1, -1):
        sums_up = _Sums(reference.levels[k], reference.groups, levels[k], GATE_M[k])
        if k == coarsest:
            sums_up(T, sigma, shade)
            shade = sums_up.shade(shade)
        for _ in range(STEPS[k]):
            sums_up(T, sigma, shade)
            step = sums_up.step(T, prior)
            sigma = sums_up.sigma(sigma)
            shade = sums_up.shade(shade)
            T = se3.exp(step) @ T
            if np.abs(step).max() < STILL[k]:
                break
    T = se3.tidied(T)
    sums_up(T, sigma, shade)
    return sums_up.result(T, sigma, shade)


class _Sums:
    """The sums over the points of one level, and the values that follow from them."""

    def __init__(self, points: Points, groups: int, level: Level, gate_m: float) -> None:
        self._points, self._level = points, level
        self._gate = np.array([gate_m, GATE_DEVIATIONS])
        self._system = np.empty((7, 6))
        self._sums = np.empty(kernel.SUMS)
        self._shades = np.empty((groups, kernel.GROUP_SUMS))

    def __call__(self, T: Float64Array, sigma: Float64Array, shade: Float64Array) -> None:
        p = self._points
        kernel.accumulate(
            p.points,
            p.normals,
            p.intensity,
            p.group,
            shade,
            self._level.image,
            self._level.camera.pinhole,
            np.ascontiguousarray(T),
            sigma,
            NOISE,
            self._gate,
            self._system,
            self._sums,
            self._shades,
        )

    def step(self, T: Float64Array, prior: Prior | None) -> Float64Array:
        """Return the Gauss-Newton step (6,); zero in directions that the points do not determine."""
        H, b = self._system[:6].copy(), self._system[6].copy()
        if prior is not None:
            away = se3.log(T @ se3.inverse(prior.T_camera_reference))
            H += prior.information
            b -= prior.information @ away
        H[np.diag_indices(6)] += 1e-3 + 1e-6 * H.diagonal()
        step: Float64Array = np.linalg.solve(H, b)
        return step

    def sigma(self, sigma: Float64Array) -> Float64Array:
        """Return the scales of the residuals, updated from the weighted residuals."""
        s = self._sums
        scale = np.array(
            [s[kernel.SQUARES_I] / max(s[kernel.SHADED], 1.0), s[kernel.SQUARES_D] / max(s[kernel.INLIERS], 1.0)]
        )
        return np.asarray(np.clip(sigma * np.sqrt(scale), SIGMA_LOW, SIGMA_HIGH))

    def shade(self, shade: Float64Array) -> Float64Array:
        """Return gain and bias of each group, which make mean and variance of the intensities equal."""
        weight, reference, image, reference2, image2, _ = self._shades.T
        n = np.maximum(weight, 1.0)
        reference, image = reference / n, image / n
        variance = np.maximum(reference2 / n - reference**2, 0.0), np.maximum(image2 / n - image**2, 0.0)
        gain = np.sqrt((variance[0] + FLAT) / (variance[1] + FLAT))
        gain = np.clip(gain, 0.5, 2.0)
        found = np.column_stack([gain, reference - gain * image])
        return np.where((weight > 20.0)[:, None], found, shade)

    def correlation(self) -> Float64Array:
        """Return the correlation of the intensities for each group (G,)."""
        weight, reference, image, reference2, image2, both = self._shades.T
        n = np.maximum(weight, 1.0)
        reference, image = reference / n, image / n
        spread = (reference2 / n - reference**2 + FLAT) * (image2 / n - image**2 + FLAT)
        return np.asarray((both / n - reference * image + FLAT) / np.sqrt(np.maximum(spread, 1.0)))

    def result(self, T: Float64Array, sigma: Float64Array, shade: Float64Array) -> Alignment:
        s = self._sums
        correlation = self.correlation()
        return Alignment(
            T,
            self._system[:6].copy(),
            float(s[kernel.IN_IMAGE] / max(len(self._points.points), 1)),
            int(s[kernel.ON_SURFACE]),
            float(s[kernel.ON_SURFACE] / max(s[kernel.WITH_DEPTH], 1.0)),
            float(correlation.max()),
            sigma,
            shade,
        )
