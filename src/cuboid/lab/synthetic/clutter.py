"""Things that nobody calls an object: cables, sheets of paper, leaflets, crumpled cloth. They count neither way."""

from __future__ import annotations

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.draft import Draft
from cuboid.lab.synthetic.footprint import gap_m, hull
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.shapes.model import Model

# Minimum distance of clutter that rises from the surface from objects, metres.
CLUTTER_CLEARANCE_M = 0.008
# Random draws for a free place before a piece is left out.
PIECE_TRIES = 40


def add_papers(draft: Draft, surface: int, count: int) -> None:
    """Lay sheets of paper on a surface: flat ones anywhere, also below objects, and curled ones on free places."""
    rng, top = draft.rng, draft.objects.surfaces[surface]
    for number in range(count):
        model = draft.make("paper", curl=0.0 if number % 2 == 0 else rng.uniform(0.008, 0.03))
        _lay(
            draft,
            model,
            surface,
            gap=0.0 if number % 2 == 0 else CLUTTER_CLEARANCE_M,
            lift=top.height_m + 1e-4 * number,
        )


def add_clutter(draft: Draft, surface: int, *, leaflets: int = 0, cloths: int = 0) -> None:
    """Lay leaflets and crumpled cloths on free places of a surface."""
    height = draft.objects.surfaces[surface].height_m
    for name, count in (("leaflet", leaflets), ("cloth", cloths)):
        for _ in range(count):
            _lay(draft, draft.make(name), surface, CLUTTER_CLEARANCE_M, height)


def _lay(draft: Draft, model: Model, surface: int, gap: float, lift: float) -> None:
    rng, top = draft.rng, draft.objects.surfaces[surface]
    outline = hull(model.mesh().vertices[:, :2])
    for _ in range(PIECE_TRIES):
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
        for _ in range(PIECE_TRIES):
            start, end = top.at(*rng.uniform(-0.9, 0.9, 2)), top.at(rng.uniform(-0.9, 0.9), rng.uniform(0.5, 1.0))
            along = end - start
            across = np.array([-along[1], along[0]])
            bends = rng.uniform(-0.25, 0.25, 3)
            sway = sum(b * np.sin((k + 1) * np.pi * t) / (k + 1) for k, b in enumerate(bends))
            path = start + t[:, None] * along + np.asarray(sway)[:, None] * across
            clear = all(_apart(path, outline, CLUTTER_CLEARANCE_M) for outline in outlines)
            if np.linalg.norm(along) > 0.15 and top.contains(path, 0.0) and clear:
                draft.add(draft.make("cable", path=path), shift((0, 0, top.height_m)), doubtful=True)
                break
