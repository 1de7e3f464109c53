"""Meshes beyond boxes and bodies of revolution: lofts, pipes, sheets, rounded boxes, smooth unions; metres, z up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.mesh import WELD_M, Mesh, box, merged, strip_faces, without_slivers

# Corners of the cross-section of a pipe.
PIPE_SEGMENTS = 12
# Points per rounded corner of an outline, and rings per rounded edge of a box.
CORNER_POINTS, EDGE_RINGS = 6, 4
# Sine waves that are added to displace a surface.
WAVES = 9
# Corners of a cell of a field (x, y, z), and its six tetrahedra, which share a diagonal.
_CORNERS = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)])
_TETRAHEDRA = np.array([[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]])


def loft(rings: npt.ArrayLike, *, capped: bool = True) -> Mesh:
    """Return the surface through closed rings (K, S, 3), each counter-clockwise seen from the next one.

    With `capped` the first and the last ring are closed by a fan around their middle.
    """
    rows = np.asarray(rings, np.float64)
    if capped:
        first, last = (np.broadcast_to(row.mean(0), row.shape)[None] for row in (rows[0], rows[-1]))
        rows = np.concatenate([first, rows, last])
    return without_slivers(Mesh(rows.reshape(-1, 3), strip_faces(len(rows), rows.shape[1], wrap=True)))


def swept(outline: npt.ArrayLike, profile: npt.ArrayLike) -> Mesh:
    """Return an outline (S, 2) scaled and raised along a profile (K, 2) of scale and height.

    As for `lathe`, the outside lies to the right of the profile: up on the outer wall, down on the inner one.
    """
    ring = np.asarray(outline, np.float64)
    return loft([np.column_stack([scale * ring, np.full(len(ring), height)]) for scale, height in np.asarray(profile)])


def hollow(outer: npt.ArrayLike, wall_m: float, floor_m: float) -> Float64Array:
    """Return the closed profile of a vessel with the outer profile (K, 2), from its foot to its rim."""
    outside = np.asarray(outer, np.float64)
    inside = outside[::-1] - (wall_m, 0.0)
    inside[:, 1] = np.maximum(inside[:, 1], outside[0, 1] + floor_m)
    return np.concatenate([[(0.0, outside[0, 1])], outside, inside, [(0.0, inside[-1, 1])]])


def rounded_rectangle(x: float, y: float, radius: float) -> Float64Array:
    """Return the outline (S, 2) of a rectangle x by y with rounded corners, counter-clockwise."""
    angle = np.linspace(0, np.pi / 2, CORNER_POINTS)
    arcs = [
        (sx * (x / 2 - radius), sy * (y / 2 - radius))
        + radius * np.column_stack([np.cos(angle + a), np.sin(angle + a)])
        for sx, sy, a in ((1, 1, 0.0), (-1, 1, np.pi / 2), (-1, -1, np.pi), (1, -1, 1.5 * np.pi))
    ]
    return np.concatenate(arcs)


def superellipse(x: float, y: float, exponent: float, points: int = 40) -> Float64Array:
    """Return the outline (points, 2) |2 u / x|^exponent + |2 v / y|^exponent = 1, counter-clockwise."""
    angle = np.arange(points) * (2 * np.pi / points)
    c, s = np.cos(angle), np.sin(angle)
    power = 2.0 / exponent
    return np.column_stack([x / 2 * np.sign(c) * np.abs(c) ** power, y / 2 * np.sign(s) * np.abs(s) ** power])


def rounded_box(size: Sequence[float], radius: float, edge: float, bottom: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a box of `size` (x, y, z) with rounded upright edges (`radius`) and rounded level edges (`edge`).

    `bottom` is the centre of its bottom face.
    """
    x, y, z = size
    bend = np.linspace(0, np.pi / 2, EDGE_RINGS)
    inset = edge * np.concatenate([1 - np.sin(bend), 1 - np.cos(bend)])
    height = np.concatenate([edge * (1 - np.cos(bend)), z - edge + edge * np.sin(bend)])
    rings = []
    for off, level in zip(inset, height, strict=True):
        ring = rounded_rectangle(x - 2 * off, y - 2 * off, max(radius - off, 1e-4))
        rings.append(np.column_stack([ring, np.full(len(ring), level)]) + np.asarray(bottom))
    return loft(rings)


def superellipsoid(radii: Sequence[float], exponent: float, points: int = 40) -> Mesh:
    """Return the body |x/a|^e + |y/b|^e + |z/c|^e = 1 around the origin; 2 is an ellipsoid, more is boxier."""
    rise = np.linspace(-np.pi / 2, np.pi / 2, points // 2 + 1)[1:-1]
    power = 2.0 / exponent
    level = np.sign(np.sin(rise)) * np.abs(np.sin(rise)) ** power
    width = np.cos(rise) ** power
    ring = superellipse(2 * radii[0], 2 * radii[1], exponent, points)
    rings = [np.column_stack([w * ring, np.full(points, radii[2] * z)]) for w, z in zip(width, level, strict=True)]
    poles = [np.broadcast_to((0.0, 0.0, s * radii[2]), (points, 3)) for s in (-1, 1)]
    return loft([poles[0], *rings, poles[1]], capped=False)


def pipe(path: npt.ArrayLike, radius: npt.ArrayLike, flat: float = 1.0) -> Mesh:
    """Return a pipe along a path (K, 3); `radius` is a number or (K,), `flat` the ratio of its second radius.

    The cross-section is turned as little as possible from point to point; at first its second axis is as upright as
    possible.
    """
    line = np.asarray(path, np.float64)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    up = np.array((0.0, 0.0, 1.0)) if abs(tangent[0, 2]) < 0.9 else np.array((0.0, 1.0, 0.0))
    radii = np.broadcast_to(np.asarray(radius, np.float64), len(line))
    angle = np.arange(PIPE_SEGMENTS) * (2 * np.pi / PIPE_SEGMENTS)
    rings = []
    for point, along, r in zip(line, tangent, radii, strict=True):
        up = up - (up @ along) * along
        up /= np.linalg.norm(up)
        side = np.cross(up, along)
        rings.append(point + r * (np.outer(np.cos(angle), side) + flat * np.outer(np.sin(angle), up)))
    return loft(rings)


def sheet(points: npt.ArrayLike, thick_m: npt.ArrayLike) -> Mesh:
    """Return a closed sheet whose upper side is a grid of points (A, B, 3), B to the right of A.

    `thick_m` is its thickness, measured downwards: a number or (A, B).
    """
    top = np.asarray(points, np.float64)
    low = top.copy()
    low[..., 2] -= np.asarray(thick_m, np.float64)
    ring = np.concatenate([low, top[::-1]]).transpose(1, 0, 2)
    middle = (low + top) / 2
    ends = [np.concatenate([middle[:, k], middle[::-1, k]])[None] for k in (0, -1)]
    return loft(np.concatenate([ends[0], ring, ends[1]]), capped=False)


def ribbon(x: npt.ArrayLike, width: npt.ArrayLike, z: npt.ArrayLike, thick: npt.ArrayLike) -> Mesh:
    """Return a flat bar along x with a width (K,), a height of its middle (K,) and a thickness at each station."""
    columns = np.broadcast_arrays(*(np.asarray(one, np.float64) for one in (x, width, z, thick)))
    corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    rings = [
        np.column_stack([np.full(4, a), corners[:, 0] * w, level + corners[:, 1] * t])
        for a, w, level, t in zip(*columns, strict=True)
    ]
    return loft(rings)


def displaced(mesh: Mesh, rng: np.random.Generator, amplitude_m: float, wave_m: float) -> Mesh:
    """Return the mesh with its vertices displaced along their normals by smooth noise of about this wavelength."""
    keys = np.round(mesh.vertices / WELD_M).astype(np.int64)
    _, welded = np.unique(keys, axis=0, return_inverse=True)
    welded = welded.reshape(-1)
    normals = np.zeros((int(welded.max()) + 1, 3))
    np.add.at(normals, welded[mesh.faces].reshape(-1), np.repeat(mesh.area_normals(), 3, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    offset = amplitude_m * waves(mesh.vertices, rng, wave_m)
    return Mesh(mesh.vertices + offset[:, None] * normals[welded], mesh.faces)


def waves(points: Float64Array, rng: np.random.Generator, wave_m: float) -> Float64Array:
    """Return smooth noise (N,) of about -1 to 1 at points (N, D), a sum of sine waves in random directions."""
    direction = rng.standard_normal((WAVES, points.shape[1]))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    number = 2 * np.pi / (wave_m * rng.uniform(0.7, 1.6, WAVES))
    phase = points @ (direction * number[:, None]).T + rng.uniform(0, 2 * np.pi, WAVES)
    noise: Float64Array = np.sin(phase).sum(1) * np.sqrt(0.5 / WAVES)
    return noise


def flattened(mesh: Mesh, height_m: float) -> Mesh:
    """Return the mesh with everything below a height pressed up to it: a body with a flat foot."""
    vertices = mesh.vertices.copy()
    vertices[:, 2] = np.maximum(vertices[:, 2], height_m)
    return without_slivers(Mesh(vertices, mesh.faces))


def blended(balls: Sequence[tuple[Sequence[float], Sequence[float]]], smooth_m: float, cell_m: float) -> Mesh:
    """Return the smooth union of ellipsoids with axes along x, y, z.

    Parameters
    ----------
    balls : sequence of (center, radii)
    smooth_m : float
        Width of the joints.
    cell_m : float
        Side of the cells of the field whose zero is the surface.

    The distance from an ellipsoid is the first-order estimate |p/r| (|p/r| - 1) / |p/r^2| (Quilez, iquilezles.org), and
    the smooth minimum of the distances is -s log(sum exp(-d / s)).
    """
    center, radii = (np.array([ball[k] for ball in balls], np.float64) for k in (0, 1))
    margin = 2 * cell_m + smooth_m
    low, high = (center - radii).min(0) - margin, (center + radii).max(0) + margin
    axes = [np.arange(a, b + cell_m, cell_m) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    total = np.zeros(points.shape[:3])
    for c, r in zip(center, radii, strict=True):
        far = np.linalg.norm((points - c) / r, axis=-1)
        slope = np.linalg.norm((points - c) / r**2, axis=-1)
        distance = far * (far - 1) / np.maximum(slope, 1e-9)
        total += np.exp(np.clip(-distance / smooth_m, -50, 50))
    return isosurface(-smooth_m * np.log(np.maximum(total, 1e-30)), points)


def isosurface(field: Float64Array, points: Float64Array) -> Mesh:
    """Return the surface where a field (X, Y, Z) at grid points (X, Y, Z, 3) is zero, by marching tetrahedra.

    The inside is negative (Doi and Koide, IEICE Transactions 1991).
    """
    shape = np.array(field.shape)
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    values, places = field.reshape(-1), points.reshape(-1, 3)
    corner = (cells[:, None] + _CORNERS) @ np.array([shape[1] * shape[2], shape[2], 1])
    crossed = (values[corner] < 0).any(1) & (values[corner] >= 0).any(1)
    tetrahedra = corner[crossed][:, _TETRAHEDRA].reshape(-1, 4)
    inside = values[tetrahedra] < 0
    order = np.argsort(~inside, axis=1, kind="stable")
    a, b, c, d = np.take_along_axis(tetrahedra, order, axis=1).T
    count = inside.sum(1)
    triangles = []
    for number, edges in (
        (1, ((a, b), (a, c), (a, d))),
        (3, ((d, a), (d, b), (d, c))),
        (2, ((a, c), (a, d), (b, d))),
        (2, ((a, c), (b, d), (b, c))),
    ):
        chosen = count == number
        triangles.append(np.stack([np.sort(np.column_stack(edge)[chosen], axis=1) for edge in edges], axis=1))
    ends, index = np.unique(np.concatenate(triangles).reshape(-1, 2), axis=0, return_inverse=True)
    first, second = values[ends].T
    weight = (first / (first - second))[:, None]
    vertices = places[ends[:, 0]] * (1 - weight) + places[ends[:, 1]] * weight
    mesh = Mesh(vertices, index.reshape(-1, 3).astype(np.int32))
    outward = np.concatenate([_outward(places, inside, tetrahedra, count == number) for number in (1, 3, 2, 2)])
    wrong = np.einsum("ij,ij->i", mesh.area_normals(), outward) < 0
    mesh.faces[wrong] = mesh.faces[wrong, ::-1]
    return without_slivers(mesh)


def _outward(
    places: Float64Array,
    inside: npt.NDArray[np.bool_],
    tetrahedra: npt.NDArray[np.int64],
    chosen: npt.NDArray[np.bool_],
) -> Float64Array:
    """Return the direction from the inner to the outer corners of each chosen tetrahedron, (N, 3)."""
    corner, within = places[tetrahedra[chosen]], inside[chosen][..., None]
    outer = (corner * ~within).sum(1) / (~within).sum(1)
    inner = (corner * within).sum(1) / within.sum(1)
    direction: Float64Array = outer - inner
    return direction


def keys(x: float, y: float, columns: int, rows: int, z: float) -> Mesh:
    """Return a field of keys x by y with its middle at the origin, tops at z + 4 mm."""
    a, b = x / columns, y / rows
    places = [((i + 0.5) * a - x / 2, (j + 0.5) * b - y / 2) for i in range(columns) for j in range(rows)]
    skipped = {(i, 0) for i in range(columns // 3, 2 * columns // 3)} if rows > 4 else set()
    field = [
        box((a * 0.84, b * 0.84, 0.004), (*place, z))
        for k, place in enumerate(places)
        if (k // rows, k % rows) not in skipped
    ]
    if skipped:
        field.append(box((a * (len(skipped) - 0.16), b * 0.84, 0.004), (0, places[0][1], z)))
    return merged(field)


def extruded(side: Float64Array, wide: float, taper: float = 0.92) -> Mesh:
    """Return a side view (x, z), counter-clockwise, extruded along y, with slightly narrower ends."""
    middle = side.mean(0)
    rings = []
    for y, scale in ((wide / 2, taper), (wide * 0.4, 1.0), (-wide * 0.4, 1.0), (-wide / 2, taper)):
        points = middle + (side - middle) * scale
        rings.append(np.column_stack([points[:, 0], np.full(len(side), y), points[:, 1]]))
    return loft(rings)
