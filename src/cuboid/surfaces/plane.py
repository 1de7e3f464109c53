"""One supporting plane: its moments, where it lies, and what it covers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cuboid.frame import Float64Array
from cuboid.surfaces.grid import GroundPlan
from cuboid.tolerances import DRIFT_M, DRIFT_RAD, JUMP_M, LEAST_SIGMA_M, LITTLE, SIGMAS

# A horizontal cell belongs to a plane when it is within this of it, metres, or three standard deviations.
ON_PLANE_M = 0.02
# How far a frame sees a plane from where the map has it.
_PRIOR = np.diag([DRIFT_RAD**-2, DRIFT_RAD**-2, DRIFT_M**-2])


@dataclass(slots=True, eq=False)
class Plane:
    """A tracked plane; moments are in the plan frame, weighted by area over variance.

    Attributes
    ----------
    index : int
        Its place among the planes, -1 when it is no more.
    identity : int
        Its own for good, never given to another plane.
    frames, last_frame : int
        Frames that saw it, and the last of these.
    in_use : bool
        Objects may stand on it.
    plan : GroundPlan
        What it covers.
    taken_by : Plane or None
        The one that it turned out to be a part of.
    """

    index: int = -1
    identity: int = -1
    weight: float = 0.0
    mean: Float64Array = field(default_factory=lambda: np.zeros(3))
    scatter: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    normal: Float64Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    offset: float = 0.0
    frames: int = 0
    last_frame: int = 0
    in_use: bool = False
    plan: GroundPlan = field(default_factory=GroundPlan)
    taken_by: Plane | None = None

    def add(self, points: Float64Array, weights: Float64Array) -> None:
        """Take in points (N, 3) of the plane."""
        w = float(weights.sum())
        mean = weights @ points / w
        centred = points - mean
        step = mean - self.mean
        total = self.weight + w
        self.scatter += (centred * weights[:, None]).T @ centred + np.outer(step, step) * (self.weight * w / total)
        self.mean = self.mean + step * (w / total)
        self.weight = total

    def absorb(self, other: Plane) -> None:
        """Take in another plane that turned out to be the same."""
        step = other.mean - self.mean
        total = self.weight + other.weight
        self.scatter += other.scatter + np.outer(step, step) * (self.weight * other.weight / total)
        self.mean = self.mean + step * (other.weight / total)
        self.weight = total
        self.frames = max(self.frames, other.frames)
        self.last_frame = max(self.last_frame, other.last_frame)
        self.in_use |= other.in_use
        self.fit()
        self.plan.absorb(other.plan)
        other.taken_by = self

    def fit(self) -> None:
        """Find normal and offset: a horizontal plane, tilted as far as its own points demand.

        The slope (a, b) of height over the plan minimises the weighted squared residual plus a prior of 2 degrees
        that a narrow or noisy plane cannot overcome.
        """
        s = self.scatter / max(self.weight, 1e-12)
        spread = JUMP_M**2 / 0.035**2  # a residual of 1 cm against a slope of 2 degrees
        slope = np.linalg.solve(s[:2, :2] + spread * np.eye(2) * JUMP_M, s[:2, 2])
        normal = np.array([-slope[0], -slope[1], 1.0])
        self.normal = normal / np.linalg.norm(normal)
        self.offset = -float(self.normal @ self.mean)

    def move(self, points: Float64Array) -> None:
        """Let the plane lie where its points (N, 3), in the plan frame, now are; it stays as sure as it was."""
        self.mean = points.mean(0)
        centred = points - self.mean
        self.scatter = centred.T @ centred * (self.weight / len(points))
        self.fit()
        self.plan.move(points)

    def height(self, points: Float64Array) -> Float64Array:
        """Return the heights (N,) of points (N, 3) above the plane."""
        return points @ self.normal + self.offset

    def adapted(self, points: Float64Array, sigma_m: Float64Array) -> tuple[Float64Array, float]:
        """Return normal and offset shifted and tilted to a frame's points (N, 3) on it, as far as drift goes.

        Ridge regression, once reweighted; `sigma_m` (N,) are the standard deviations of the points.
        """
        middle = points.mean(0)
        design = points - middle
        design[:, 2] = 1.0
        residual = self.height(points)
        finest_m = SIGMAS * LEAST_SIGMA_M
        weights = 1.0 / (sigma_m**2 + finest_m**2)
        solution: Float64Array = np.zeros(3)
        for _ in range(2):
            # Neighbouring cells err alike: a frame's cells count as a tenth of their number.
            w = LITTLE * weights / (1.0 + ((residual - design @ solution) / (SIGMAS * sigma_m + finest_m)) ** 2)
            solution = np.asarray(np.linalg.solve(design.T @ (design * w[:, None]) + _PRIOR, design.T @ (w * residual)))
        normal = self.normal - np.array([solution[0], solution[1], 0.0])
        offset = self.offset - solution[2] + float(solution[:2] @ middle[:2])
        norm = float(np.linalg.norm(normal))
        return normal / norm, offset / norm
