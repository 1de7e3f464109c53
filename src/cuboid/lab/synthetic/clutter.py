"""Things that nobody calls an object: cables, sheets of paper, leaflets, crumpled cloth. They count neither way."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.draft import Draft
from cuboid.lab.synthetic.footprint import gap_m, hull
from cuboid.lab.synthetic.material import Material, Texture, two_paints
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.shapes.model import Model, choice, standing
from cuboid.lab.synthetic.solids import flattened, pipe, sheet, waves

# Size of a sheet of paper (ISO A4) and its thickness with a few sheets below it, metres.
PAPER_M, PAPER_THICK_M = (0.297, 0.21), 0.0006
# Radius of a cable, metres.
CABLE_M = 0.0028
# Minimum distance of clutter that rises from the surface from objects, metres.
CLEAR_M = 0.008
# Random draws for a free place before a piece is left out.
TRIES = 40


def cable(rng: np.random.Generator, path: Float64Array) -> Model:
    """Return a cable along a path (K, 2) on the surface; the path is not moved to the origin."""
    line = np.column_stack([path, np.full(len(path), CABLE_M)])
    color = choice(rng, ((0.08, 0.08, 0.09), (0.08, 0.08, 0.09), (0.92, 0.92, 0.9), (0.55, 0.56, 0.58)))
    return Model("cable", ((pipe(line, CABLE_M), Material(color, shine=0.2)),))


def paper(rng: np.random.Generator, curl_m: float = 0.0) -> Model:
    """Return a sheet of paper, printed or blank, with corners that rise by up to `curl_m`."""
    x, y = PAPER_M
    u, v = np.meshgrid(np.linspace(-1, 1, 15), np.linspace(-1, 1, 21), indexing="ij")
    bearing = rng.uniform(0, 2 * np.pi)
    rise = np.clip((u * np.cos(bearing) + v * np.sin(bearing) - 0.2) / 1.2, 0, None) ** 2
    points = np.stack([v * x / 2, u * y / 2, PAPER_THICK_M + curl_m * rise], axis=-1)
    blank, print_ink = (0.95, 0.95, 0.94), (0.55, 0.56, 0.60)
    look = choice(rng, (Material(blank), Material(blank, print_ink, Texture.BANDS, 0.014)))
    return standing("paper", (sheet(points, PAPER_THICK_M), look))


def leaflet(rng: np.random.Generator) -> Model:
    """Return a folded leaflet that lies, its folds a little open."""
    panels, wide, high = 3, 0.1, 0.21
    opening = rng.uniform(0.0, 0.1)
    x = np.linspace(0, panels * wide * np.cos(opening), 2 * panels + 1)
    z = 0.0012 + wide * np.sin(opening) * np.tile([0.0, 0.5, 1.0, 0.5], panels)[: 2 * panels + 1]
    points = np.stack(np.broadcast_arrays(x, np.linspace(-high / 2, high / 2, 5)[:, None], z), axis=-1)
    color, second = two_paints(rng)
    return standing("leaflet", (sheet(points, 0.001), Material(color, second, Texture.BANDS, 0.04, 0.3)))


def crumpled_cloth(rng: np.random.Generator) -> Model:
    """Return a cloth that lies crumpled, up to 6 cm high."""
    half, count = rng.uniform(0.12, 0.17), 44
    u, v = np.meshgrid(np.linspace(-1, 1, count), np.linspace(-1, 1, count), indexing="ij")
    flat = np.column_stack([v.ravel(), u.ravel()])
    ridges = (1.0 - np.abs(waves(flat, rng, 0.9))) ** 2 + 0.35 * (1.0 - np.abs(waves(flat, rng, 0.4)))
    edge = np.clip(1.15 - np.linalg.norm(flat, axis=1) / 1.2, 0.08, 1)
    height = 0.003 + 0.042 * np.clip(ridges, 0, None) * edge
    bent = half * (1 + 0.12 * np.column_stack([waves(flat, rng, 1.5), waves(flat, rng, 1.5)]))
    points = np.column_stack([flat * bent, height]).reshape(count, count, 3)
    color, second = two_paints(rng)
    pattern = choice(rng, (Texture.PLAIN, Texture.CHECKER, Texture.STRIPES))
    mesh = flattened(sheet(points, 0.0025), 0.0)
    return standing("cloth", (mesh, Material(color, second, pattern, 0.03)))


def add_papers(draft: Draft, surface: int, count: int) -> None:
    """Lay sheets of paper on a surface: flat ones anywhere, also below objects, and curled ones on free places."""
    rng, top = draft.rng, draft.objects.surfaces[surface]
    for number in range(count):
        model = paper(rng, 0.0 if number % 2 == 0 else rng.uniform(0.008, 0.03))
        _lay(draft, model, surface, gap=0.0 if number % 2 == 0 else CLEAR_M, lift=top.height_m + 1e-4 * number)


def add_clutter(draft: Draft, surface: int, *, leaflets: int = 0, cloths: int = 0) -> None:
    """Lay leaflets and crumpled cloths on free places of a surface."""
    height = draft.objects.surfaces[surface].height_m
    for make, count in ((leaflet, leaflets), (crumpled_cloth, cloths)):
        for _ in range(count):
            _lay(draft, make(draft.rng), surface, CLEAR_M, height)


def _lay(draft: Draft, model: Model, surface: int, gap: float, lift: float) -> None:
    rng, top = draft.rng, draft.objects.surfaces[surface]
    outline = hull(model.mesh().vertices[:, :2])
    for _ in range(TRIES):
        angle, place = rng.uniform(0, 2 * np.pi), top.at(*rng.uniform(-0.85, 0.85, 2))
        c, s = np.cos(angle), np.sin(angle)
        lying = outline @ np.array([[c, s], [-s, c]]) + place
        if top.contains(lying, 0.004) and (gap == 0.0 or _is_free(draft, lying, surface, gap)):
            draft.add(model, shift((*place, lift)) @ turn(angle), doubtful=True)
            return


def _is_free(draft: Draft, outline: Float64Array, surface: int, gap: float) -> bool:
    """Tell whether an outline is `gap` metres from the objects and from the risen clutter of a surface."""
    height = draft.objects.surfaces[surface].height_m
    lying = [
        hull(body.mesh().vertices[:, :2])
        for body in draft.furniture
        if body.model.name in ("leaflet", "cloth") and abs(body.T_room_model[2, 3] - height) < 0.01
    ]
    return all(gap_m(outline, one) >= gap for one in (*draft.objects.outlines(surface), *lying))


def _apart(points: Float64Array, outline: Float64Array, gap: float) -> bool:
    """Tell whether points (N, 2) are beyond some side of a convex outline (K, 2) by `gap` metres each."""
    sides = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.linalg.norm(sides, axis=1, keepdims=True)
    beyond = points @ normals.T - np.einsum("ij,ij->i", outline, normals)
    return bool((beyond.max(axis=1) >= gap).all())


def add_cables(draft: Draft, surface: int, count: int) -> None:
    """Lay cables on free places of a surface, each from some place to its edge at +y, in bends."""
    rng, top = draft.rng, draft.objects.surfaces[surface]
    t, outlines = np.linspace(0, 1, 40), draft.objects.outlines(surface)
    for _ in range(count):
        for _ in range(TRIES):
            start, end = top.at(*rng.uniform(-0.9, 0.9, 2)), top.at(rng.uniform(-0.9, 0.9), rng.uniform(0.5, 1.0))
            along = end - start
            across = np.array([-along[1], along[0]])
            bends = rng.uniform(-0.25, 0.25, 3)
            sway = sum(b * np.sin((k + 1) * np.pi * t) / (k + 1) for k, b in enumerate(bends))
            path = start + t[:, None] * along + np.asarray(sway)[:, None] * across
            clear = all(_apart(path, outline, CLEAR_M) for outline in outlines)
            if np.linalg.norm(along) > 0.15 and top.contains(path, 0.0) and clear:
                draft.add(cable(rng, path), shift((0, 0, top.height_m)), doubtful=True)
                break
