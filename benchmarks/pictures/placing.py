"""Where things stand: apart, in touch, in rows, on and in each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from catalog import SMALL
from devices import book, phone
from groceries import block, can, carton, jar
from meshes import Color, Floats, Rng, pick, rotation
from prints import mean_color, random_color
from scans import scan
from scipy.spatial import ConvexHull
from thing import Maker, Thing
from vessels import mug

from scene import STRUCTURE, Scene

# Ends of an area: x0, x1, y0, y1.
Region = tuple[float, float, float, float]
# Gap to the nearest neighbour, at least and for things that stand beside it, metres; height from which things drop.
LEAST_GAP_M, NEAR_GAP_M, DROP_M = 0.0003, (0.0005, 0.012), 0.001
# Things that stand on others.
UPPER: tuple[Maker, ...] = (can, carton, book, block, jar, scan, mug, phone)


@dataclass(frozen=True)
class Placed:
    """A thing that stands at a place (x, y), turned about z."""

    thing: Thing
    place: Floats
    turn_deg: float


class Colors:
    """Colors of the things of a scene: random, at times that of an earlier thing or of the furniture and the room."""

    def __init__(self, scene: Scene) -> None:
        rng = scene.rng
        self.rng, self.past = rng, [mean_color(b.parts[0]) for b in scene.bodies if b.label == STRUCTURE]
        self.repeats = rng.uniform(0.1, 0.8) if rng.random() < 0.25 else 0.06

    def __call__(self) -> Color:
        """Return the color of the next thing."""
        if self.rng.random() < self.repeats:
            old = pick(self.rng, self.past)
            return tuple(float(x) for x in np.clip(np.array(old) + self.rng.normal(0, 0.02, 3), 0.02, 1))  # type: ignore[return-value]
        self.past.append(random_color(self.rng))
        return self.past[-1]


def make(scene: Scene, makers: Sequence[Maker], count: int, colors: Colors | None = None) -> list[Thing]:
    """Return new things of random makers."""
    colors = colors or Colors(scene)
    return [pick(scene.rng, makers)(scene.rng, colors()) for _ in range(count)]


def outline(thing: Thing, turn: Floats) -> Floats:
    """Return the convex outline (n, 2) of a turned thing seen from above."""
    points = (thing.points() @ turn.T)[:, :2]
    return points[ConvexHull(points, qhull_options="QJ").vertices]


def gap(a: Floats, b: Floats) -> float:
    """Return the widest separation of convex outlines along the normals of their edges, metres; below 0: overlap."""
    best = -np.inf
    for polygon in (a, b):
        edge = np.roll(polygon, -1, 0) - polygon
        normal = np.stack([edge[:, 1], -edge[:, 0]], 1) / (np.linalg.norm(edge, axis=1, keepdims=True) + 1e-9)
        of_a, of_b = a @ normal.T, b @ normal.T
        best = max(best, (of_b.min(0) - of_a.max(0)).max(), (of_a.min(0) - of_b.max(0)).max())
    return float(best)


def put_where_free(
    scene: Scene, thing: Thing, region: Region, z: float, turn_deg: float, taken: list[Floats], tries: int = 20
) -> None:
    """Fix a thing with its origin at a free place of a region; leave it out if all tries fail."""
    shape = outline(thing, rotation("z", turn_deg))
    for _ in range(tries):
        place = scene.rng.uniform([region[0], region[2]], [region[1], region[3]])
        if all(gap(shape + place, other) > 0 for other in taken):
            scene.put(thing, (*place, z), turn_deg, falls=False)
            taken.append(shape + place)
            return


def scatter(
    scene: Scene,
    new: Sequence[Thing],
    region: Region,
    z: float,
    near: float = 0.5,
    lying: float = 0.15,
    taken: list[Floats] | None = None,
) -> list[Placed]:
    """Put things into a region at a height, without overlap, and return those that found room.

    Parameters
    ----------
    scene, new, region, z
        Scene, things to put, area (x0, x1, y0, y1) and height, metres.
    near, lying : float
        Fractions of the things that (almost) touch a neighbour, and that lie on a side.
    taken : list of array, shape (n, 2)
        Outlines to keep free; those of the placed things are added.
    """
    rng, done = scene.rng, []
    taken = [] if taken is None else taken
    low, high = np.array([region[0], region[2]]), np.array([region[1], region[3]])
    for thing in new:
        degrees = float(rng.uniform(0, 360))
        turn = rotation("z", degrees)
        if rng.random() < lying and thing.inside is None:
            turn = turn @ rotation("x" if rng.random() < 0.5 else "y", 90.0)
        shape = outline(thing, turn)
        for _ in range(40):
            beside = taken and rng.random() < near
            place = _beside(rng, shape, pick(rng, taken)) if beside else rng.uniform(low, high)
            inside = (shape + place > low).all() and (shape + place < high).all()
            if inside and all(gap(shape + place, other) > LEAST_GAP_M for other in taken):
                lift = -(thing.points() @ turn.T)[:, 2].min() + DROP_M
                scene.put(thing, (*place, z + lift), turn)
                taken.append(shape + place)
                done.append(Placed(thing, place, degrees))
                break
    return done


def _beside(rng: Rng, shape: Floats, neighbour: Floats) -> Floats:
    """Return a place (2,) of an outline at a small gap from a neighbour's, in a random direction."""
    angle, wanted = rng.uniform(0, 2 * np.pi), rng.uniform(*NEAR_GAP_M)
    direction, middle = np.array([np.cos(angle), np.sin(angle)]), neighbour.mean(0)
    steps = np.linspace(0, 0.6, 121)
    free = next((s for s in steps if gap(shape + middle + s * direction, neighbour) > wanted), steps[-1])
    return np.asarray(middle + free * direction)


def in_container(scene: Scene, below: Placed, z: float, colors: Colors) -> None:
    """Let one to six small things fall into a container that stands at a height."""
    rng = scene.rng
    assert below.thing.inside is not None
    half_w, half_d, floor, rim = below.thing.inside
    for k in range(int(rng.integers(1, 7))):
        small = pick(rng, SMALL)(rng, colors())
        reach = np.hypot(*small.size()[:2]) / 2
        if reach > 1.25 * min(half_w, half_d) and rim < 0.15:
            continue
        free = np.maximum([half_w - reach, half_d - reach], 0)
        place = below.place + rotation("z", below.turn_deg)[:2, :2] @ rng.uniform(-free, free)
        scene.put(small, (*place, z + max(floor, rim * 0.5) + 0.02 + 0.1 * k), rng.uniform(0, 360))


def on_top(scene: Scene, below: Placed, z: float, colors: Colors, most: int = 3) -> None:
    """Stack things on a flat one that stands at a height, or fill it if it is a container."""
    rng, thing = scene.rng, below.thing
    if thing.inside is not None:
        in_container(scene, below, z, colors)
        return
    for _ in range(int(rng.integers(1, most + 1))):
        if not thing.flat:
            return
        z, last = z + thing.size()[2] + DROP_M, thing
        thing = pick(rng, UPPER)(rng, colors())
        if np.prod(thing.size()[:2]) > 1.6 * np.prod(last.size()[:2]) or rng.random() < 0.25:
            thing = replace(last)  # a second one of the same kind
        place = below.place + rng.uniform(-0.006, 0.006, 2)
        scene.put(thing, (*place, z), below.turn_deg + rng.choice([0, 0, 90, 17, 200]) + rng.normal(0, 4))


def row(scene: Scene, new: Sequence[Thing], region: Region, z: float) -> list[Placed]:
    """Put things side by side along x with small gaps, each at its own depth, until the region is full."""
    rng, done, x = scene.rng, [], region[0] + scene.rng.uniform(0, 0.02)
    for thing in new:
        w, d, _ = thing.size()
        if d > region[3] - region[2] or x + w > region[1]:
            continue
        middle = (thing.points().min(0) + thing.points().max(0)) / 2
        place = np.array([x + w / 2, rng.uniform(region[2] + d / 2, region[3] - d / 2)]) - middle[:2]
        scene.put(thing, (*place, z + DROP_M))
        done.append(Placed(thing, place, 0.0))
        x += w + (rng.uniform(0.001, 0.01) if rng.random() < 0.7 else rng.uniform(0.02, 0.1))
    return done


def books_upright(scene: Scene, region: Region, z: float, height: float, colors: Colors) -> None:
    """Put books side by side with their spines to -y, as far as they go."""
    rng, x = scene.rng, region[0] + 0.002
    upright = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    while x < region[1] - rng.uniform(0.02, 0.3):
        new = book(rng, colors())
        w, d, h = new.size()
        if d < height and w < region[3] - region[2] and x + h < region[1]:
            scene.put(new, (x, region[3] - w / 2 - rng.uniform(0, 0.03), z + d / 2 + 0.001), upright, falls=False)
            x += h + rng.uniform(0.0005, 0.003)
        x += 0.001
