"""A pose graph: the keyframe poses that agree best with all motions measured between them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.geometry import se3

# Largest number of Gauss-Newton steps, and the step (metres, radians) below which the iteration stops.
MAX_STEPS = 8
STILL = 2e-5
# Beyond this many standard deviations an edge has a constant force (Huber): a wrong one cannot bend the graph much.
ROBUST_DEVIATIONS = 10.0
# Prior information of a free pose, and of a fixed one.
LOOSE, FIXED = 1e-3, 1e12


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


def residuals(edges: Sequence[Edge], T_world: Sequence[Float64Array]) -> Float64Array:
    """Return the deviation of pose b from the place given by each edge, (E, 6): translation and rotation vector."""
    poses = np.asarray(T_world)
    return _errors(*_stacked(edges)[:3], poses)


def deviations(edges: Sequence[Edge], T_world: Sequence[Float64Array]) -> Float64Array:
    """Return the deviation of the poses from each edge in standard deviations, (E,)."""
    if not edges:
        return np.empty(0)
    e = residuals(edges, T_world)
    return np.asarray(np.sqrt(np.einsum("ei,eij,ej->e", e, np.array([edge.information for edge in edges]), e)))


def optimise(
    T_world: Sequence[Float64Array], edges: Sequence[Edge], fixed: Collection[int] = (0,)
) -> list[Float64Array]:
    """Return the poses with the smallest weighted squared residuals of all edges.

    Parameters
    ----------
    T_world : sequence of (4, 4) float64
        Initial poses.
    edges : sequence of Edge
    fixed : collection of int
        Poses that do not move; poses without a chain of edges to them keep their relative positions.

    Returns
    -------
    list of (4, 4) float64
    """
    if not edges:
        return list(T_world)
    poses = np.array(T_world)
    n = len(poses)
    a, b, T_b_a, information = _stacked(edges)
    diagonal = np.full((n, 6), LOOSE)
    diagonal[sorted(fixed)] = FIXED
    for _ in range(MAX_STEPS):
        e = _errors(a, b, T_b_a, poses)
        size = np.sqrt(np.einsum("ei,eij,ej->e", e, information, e))
        weighted = information * np.minimum(1.0, ROBUST_DEVIATIONS / np.maximum(size, 1e-12))[:, None, None]
        step = _solve(a, b, _jacobian(a, b, poses), weighted, e, diagonal)
        for k in range(n):
            poses[k] = poses[k] @ se3.exp(step[k])
        if np.abs(step).max() < STILL:
            break
    return [se3.tidied(T) for T in poses]


def optimise_around(
    T_world: Sequence[Float64Array], edges: Sequence[Edge], middle: int, max_moving: int, fixed: Collection[int] = (0,)
) -> list[Float64Array]:
    """Return the poses after optimising at most `max_moving` of them, those fewest edges away from one pose.

    Parameters
    ----------
    T_world : sequence of (4, 4) float64
    edges : sequence of Edge
    middle : int
        The central pose.
    max_moving : int
        Largest number of poses that move.
    fixed : collection of int
        Poses that never move.

    Returns
    -------
    list of (4, 4) float64
    """
    neighbours: dict[int, list[int]] = {}
    for edge in edges:
        neighbours.setdefault(edge.a, []).append(edge.b)
        neighbours.setdefault(edge.b, []).append(edge.a)
    moving = {middle: None}  # in the order in which they are found
    for k in _outwards(middle, neighbours):
        if len(moving) >= max_moving:
            break
        moving[k] = None
    for k in fixed:
        moving.pop(k, None)
    used = [edge for edge in edges if edge.a in moving or edge.b in moving]
    nodes = sorted({end for edge in used for end in (edge.a, edge.b)})
    place = {node: k for k, node in enumerate(nodes)}
    still = [place[node] for node in nodes if node not in moving]
    local = [Edge(place[edge.a], place[edge.b], edge.T_a_b, edge.information) for edge in used]
    poses = list(T_world)
    found = optimise([poses[node] for node in nodes], local, still)
    for node, T in zip(nodes, found, strict=True):
        if node in moving:
            poses[node] = T
    return poses


def _outwards(middle: int, neighbours: Mapping[int, Sequence[int]]) -> Iterator[int]:
    """Yield the poses connected to a pose by edges, those fewest edges away first."""
    seen, ring = {middle}, [middle]
    while ring:
        ring = sorted({other for k in ring for other in neighbours.get(k, ())} - seen, reverse=True)
        seen.update(ring)
        yield from ring


Indices = npt.NDArray[np.int64]


def _stacked(edges: Sequence[Edge]) -> tuple[Indices, Indices, Float64Array, Float64Array]:
    """Return a, b, T_b_a and information of all edges."""
    a, b = np.array([edge.a for edge in edges]), np.array([edge.b for edge in edges])
    return (
        a,
        b,
        np.array([se3.inverse(edge.T_a_b) for edge in edges]),
        np.array([edge.information for edge in edges]),
    )


def _errors(a: Indices, b: Indices, T_b_a: Float64Array, poses: Float64Array) -> Float64Array:
    """Return translation and rotation vector (E, 6) of T_b_a T_a^-1 T_b."""
    R = poses[:, :3, :3]
    turned = R[a].transpose(0, 2, 1)
    displacement = np.einsum("eij,ej->ei", turned, poses[b, :3, 3] - poses[a, :3, 3])
    turn = T_b_a[:, :3, :3] @ turned @ R[b]
    shift = np.einsum("eij,ej->ei", T_b_a[:, :3, :3], displacement) + T_b_a[:, :3, 3]
    axis = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
    )
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    return np.concatenate([shift, axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[:, None]], 1)


def _jacobian(a: Indices, b: Indices, poses: Float64Array) -> Float64Array:
    """Return the derivative (E, 6, 6) of each residual by a motion of pose a; the derivative by pose b is the identity.

    A pose moves by T exp(xi). To first order, and near a residual of zero, the residual changes by
    xi_b - adjoint(T_b_a) xi_a.
    """
    R = poses[b, :3, :3].transpose(0, 2, 1) @ poses[a, :3, :3]
    x, y, z = np.einsum("eji,ej->ei", poses[b, :3, :3], poses[a, :3, 3] - poses[b, :3, 3]).T
    o = np.zeros_like(x)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], 1).reshape(-1, 3, 3)
    J = np.zeros((len(a), 6, 6))
    J[:, :3, :3] = J[:, 3:, 3:] = -R
    J[:, :3, 3:] = -cross @ R
    return J


def _solve(
    a: Indices, b: Indices, J: Float64Array, W: Float64Array, e: Float64Array, diagonal: Float64Array
) -> Float64Array:
    """Return the Gauss-Newton step (n, 6)."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    n = len(diagonal)
    JW = J.transpose(0, 2, 1) @ W
    gradient = np.zeros((n, 6))
    np.add.at(gradient, a, np.einsum("eij,ej->ei", JW, e))
    np.add.at(gradient, b, np.einsum("eij,ej->ei", W, e))
    block = np.concatenate([JW @ J, W, JW, JW.transpose(0, 2, 1)])
    first, second = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
    i, j = np.divmod(np.arange(36), 6)
    rows = np.concatenate([(6 * first[:, None] + i).reshape(-1), np.arange(6 * n)])
    columns = np.concatenate([(6 * second[:, None] + j).reshape(-1), np.arange(6 * n)])
    values = np.concatenate([block.reshape(-1), diagonal.reshape(-1)])
    H = csc_array((values, (rows, columns)), shape=(6 * n, 6 * n))
    return np.asarray(splu(H).solve(-gradient.reshape(-1))).reshape(n, 6)
