"""A graph of poses: the keyframes' places that agree best with all that was measured between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from cuboid.frame import Float64Array
from cuboid.geometry import se3

# Gauss-Newton steps at most, and the step (metres, radians) below which the poses stand still.
STEPS = 10
STILL = 1e-5
# Beyond so many deviations an edge pulls with a bounded force (Cauchy): a wrong one cannot bend the graph.
ROBUST_DEVIATIONS = 3.0


@dataclass(frozen=True, slots=True)
class Edge:
    """A measured motion between two poses.

    Attributes
    ----------
    a, b : int
        Numbers of the poses.
    T_a_b : (4, 4) float64
    information : (6, 6) float64
        Inverse covariance of a motion (translation, rotation) of b in its own frame.
    """

    a: int
    b: int
    T_a_b: Float64Array
    information: Float64Array


def residual(edge: Edge, T_world: Sequence[Float64Array]) -> Float64Array:
    """Return how far b is from where the edge puts it, a twist (6,) in b."""
    T_b_a = se3.inverse(edge.T_a_b)
    return se3.log(T_b_a @ se3.inverse(T_world[edge.a]) @ T_world[edge.b])


def deviations(edge: Edge, T_world: Sequence[Float64Array]) -> float:
    """Return how many deviations the poses are from what the edge measured."""
    e = residual(edge, T_world)
    return float(np.sqrt(e @ edge.information @ e))


def optimise(T_world: Sequence[Float64Array], edges: Sequence[Edge], fixed: int = 0) -> list[Float64Array]:
    """Return the poses with the least weighted squared residuals of all edges.

    Parameters
    ----------
    T_world : sequence of (4, 4) float64
        The poses to start from.
    edges : sequence of Edge
    fixed : int
        The pose that stays; poses that no chain of edges ties to it stay too.

    Returns
    -------
    list of (4, 4) float64
    """
    poses = list(T_world)
    if not edges:
        return poses
    n = len(poses)
    a, b = np.array([edge.a for edge in edges]), np.array([edge.b for edge in edges])
    # a small tie to where each pose is keeps the system regular where no edge says anything
    diagonal = np.full((n, 6), 1e-6)
    diagonal[fixed] = 1e12
    for _ in range(STEPS):
        blocks_a, blocks_b, blocks_ab, gradient = _linearised(poses, edges)
        block = np.concatenate([blocks_a, blocks_b, blocks_ab, blocks_ab.transpose(0, 2, 1)])
        rows, columns = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
        i, j = np.divmod(np.arange(36), 6)
        H = csc_array(
            (block.reshape(-1), ((6 * rows[:, None] + i).reshape(-1), (6 * columns[:, None] + j).reshape(-1))),
            shape=(6 * n, 6 * n),
        )
        H = H + csc_array((diagonal.reshape(-1), (np.arange(6 * n), np.arange(6 * n))), shape=(6 * n, 6 * n))
        step = splu(csc_array(H)).solve(-gradient.reshape(-1)).reshape(n, 6)
        poses = [T @ se3.exp(xi) for T, xi in zip(poses, step, strict=True)]
        if np.abs(step).max() < STILL:
            break
    return poses


def _linearised(
    poses: Sequence[Float64Array], edges: Sequence[Edge]
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return for each edge its blocks aa, bb, ab of the normal matrix, and the gradient (n, 6).

    A pose moves by T exp(xi). To first order the residual then changes by xi_b - adjoint(T_b_a) xi_a.
    """
    m = len(edges)
    aa, bb, ab = np.empty((m, 6, 6)), np.empty((m, 6, 6)), np.empty((m, 6, 6))
    gradient = np.zeros((len(poses), 6))
    for k, edge in enumerate(edges):
        e = residual(edge, poses)
        J = -se3.adjoint(se3.inverse(poses[edge.b]) @ poses[edge.a])
        square = float(e @ edge.information @ e)
        W = edge.information / (1.0 + square / ROBUST_DEVIATIONS**2)
        JW = J.T @ W
        aa[k], bb[k], ab[k] = JW @ J, W, JW
        gradient[edge.a] += JW @ e
        gradient[edge.b] += W @ e
    return aa, bb, ab, gradient
