"""The generator of shapes: builds a model from an entry of `shapes.toml`, which describes the format."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.resources import files
from itertools import product
from types import CodeType
from typing import Any

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic import material as materials
from cuboid.lab.synthetic import mesh as meshes
from cuboid.lab.synthetic import solids
from cuboid.lab.synthetic.material import Color, Material, Texture, paint, wood
from cuboid.lab.synthetic.mesh import Mesh, merged, shift, turn
from cuboid.lab.synthetic.shapes.model import Model, choice, standing

# Wall and floor of a tray, metres.
TRAY_WALL_M, TRAY_FLOOR_M = 0.006, 0.006
# Radius of the flat part of a plate as a fraction of its radius, and its height above the foot, metres.
PLATE_FLAT, PLATE_FLOOR_M = 0.62, 0.008
# Side of a cell of the fields of blended bodies, as a fraction of their height.
CELL = 0.028


def curve(*columns: npt.ArrayLike) -> Float64Array:
    """Return points (K, D) from their coordinates: numbers or (K,)."""
    return np.column_stack(np.broadcast_arrays(*(np.asarray(one, np.float64) for one in columns)))


def surface(*coordinates: npt.ArrayLike) -> Float64Array:
    """Return a grid of points (A, B, 3) from arrays of coordinates that broadcast to (A, B)."""
    return np.stack(np.broadcast_arrays(*coordinates), axis=-1)


def arc(center: tuple[float, float], radii: tuple[float, float], start: float, end: float, count: int) -> Float64Array:
    """Return points (count, 3) on an arc of an ellipse in the x-z plane, around (x, z); angles from +x to +z."""
    angle = np.linspace(start, end, count)
    return curve(center[0] + radii[0] * np.cos(angle), 0, center[1] + radii[1] * np.sin(angle))


def shade(color: Color, factor: float, offset: float = 0.0) -> Color:
    """Return a color whose channels are `offset + factor * channel`."""
    red, green, blue = (offset + factor * channel for channel in color)
    return red, green, blue


def leaf(length: float, width: float, bend: float) -> Float64Array:
    """Return the points (5, 12, 3) of a leaf that starts at the origin, goes out along +x and bends down."""
    t, s = np.linspace(0, 1, 12), np.linspace(-1, 1, 5)
    half = width / 2 * np.sin(np.pi * t**0.8) ** 0.9
    angle = bend * t
    x, z = np.cumsum(np.cos(angle)) * length / 12, -np.cumsum(np.sin(angle)) * length / 12
    return surface(x, s[:, None] * half, z + 0.18 * np.abs(s[:, None]) * half)


def handle(x: float, y: float, z: float) -> Float64Array:
    """Return the path (4, 3) of an upright bar handle in front of a face at `y` that faces -y."""
    return np.array([(x, y - 0.018, z), (x, y - 0.045, z), (x, y - 0.045, z + 0.14), (x, y - 0.018, z + 0.14)])


def plate_profile(r: float) -> Float64Array:
    """Return the profile (K, 2) of a plate of radius `r`."""
    flat, floor = r * PLATE_FLAT, PLATE_FLOOR_M
    outer = [(flat * 0.9, 0), (flat, 0.002), (r * 0.7, 0.0125), (r * 0.97, 0.019), (r, 0.021)]
    inner = [(r * 0.985, 0.023), (r * 0.72, 0.0175), (r * 0.68, 0.0155), (flat, floor), (0, floor)]
    return np.array([(0, 0.0), *outer, *inner])


def _lathe(profile: Any, n: int = 48, wall: float = 0.0, floor: float = 0.0) -> Mesh:
    return meshes.lathe(solids.hollow(profile, wall, floor) if wall else profile, n)


def _swept(profile: Any, outline: Any, wall: float = 0.0, floor: float = 0.0) -> Mesh:
    return solids.swept(outline, solids.hollow(profile, wall, floor) if wall else profile)


# The kinds of meshes: functions of the value of the kind and of other values of a part.
_MESHES: Mapping[str, Callable[..., Mesh]] = {
    "box": lambda size, at=(0.0, 0.0, 0.0): meshes.box(size, at),
    "rounded": lambda values, at=(0.0, 0.0, 0.0): solids.rounded_box(values[:3], values[3], values[4], at),
    "lathe": _lathe,
    "swept": _swept,
    "ball": lambda radii, e=2.0, n=40: solids.superellipsoid(radii, e, n),
    "pipe": lambda path, r, ratio=1.0: solids.pipe(path, r, ratio),
    "tube": lambda path, r: meshes.tube(path, r),
    "prism": lambda outline, height: meshes.prism(outline, height),
    "ribbon": lambda values: solids.ribbon(*values),
    "sheet": lambda points, thick: solids.sheet(points, thick),
    "grid": meshes.grid,
    "loft": solids.loft,
    "keys": lambda values: solids.keys(*values),
    "blend": lambda balls, smooth, cell=CELL: solids.blended(balls, smooth, cell),
    "mesh": lambda made: made,
    "extruded": lambda side, wide, taper=0.92: solids.extruded(side, wide, taper),
}
_ARGUMENTS = ("n", "wall", "floor", "outline", "e", "r", "ratio", "height", "thick", "smooth", "cell", "wide", "taper")
# Keys of an entry that are no sizes or choices.
_RESERVED = ("name", "origin", "parts", "either")


@cache
def _table() -> dict[str, Any]:
    table = tomllib.loads(files(__package__).joinpath("shapes.toml").read_text(encoding="utf-8"))
    functions: list[Any] = [curve, surface, arc, leaf, handle, shade, plate_profile, shift, turn]
    functions += [abs, int, range, round, zip, np.linalg.norm, solids.superellipse, solids.rounded_rectangle]
    table["names"] = {
        **{name: getattr(np, name) for name in table["names"]["numpy"]},
        **{name: getattr(materials, name) for name in table["names"]["colors"]},
        **{function.__name__: function for function in functions},
        **Texture.__members__,
        **table["looks"],
        "CLOTH": table["names"]["CLOTH"],
        "span": np.linspace,
        "SIDES": (-1, 1),
        "CORNERS": tuple(product((-1, 1), repeat=2)),
        "TRAY_WALL_M": TRAY_WALL_M,
        "TRAY_FLOOR_M": TRAY_FLOOR_M,
        "PLATE_FLAT": PLATE_FLAT,
        "PLATE_FLOOR_M": PLATE_FLOOR_M,
        "__builtins__": {},
    }
    return table


@cache
def _formula(text: str) -> CodeType:
    return compile(f"({text})", f"<{text}>", "eval")


class _Builder:
    """The sizes and choices of a model by name, and the meshes and materials that follow from them."""

    def __init__(self, rng: np.random.Generator, given: Mapping[str, Any]) -> None:
        self.rng, self._given = rng, given
        self._names: dict[str, Any] = {**_table()["names"], "waves": self._waves, **given}

    def _waves(self, points: Float64Array, wave_m: float) -> Float64Array:
        return solids.waves(points, self.rng, wave_m)

    def value(self, item: Any) -> Any:
        """Return a number, the value of a formula, or a list of these."""
        item = self.named(item)
        return [self.value(one) for one in item] if isinstance(item, list) else item

    def named(self, item: Any) -> Any:
        """Return the value of a formula; anything else as it is."""
        return eval(_formula(item), self._names) if isinstance(item, str) else item

    def draw(self, entry: Mapping[str, Any]) -> None:
        """Draw the sizes and choices of an entry, but for those that are given."""
        for name, item in entry.items():
            if name == "ranges":
                self.draw(item)
            elif name not in _RESERVED and name not in self._given:
                self._names[name] = self.drawn(item)

    def drawn(self, item: Any) -> Any:
        """Draw one size or choice."""
        if isinstance(item, dict):
            ((kind, of),) = item.items()
            return _DRAWS[kind](self, of)
        if isinstance(item, list) and len(item) == 2 and not isinstance(item[0], list | str):
            return self.rng.uniform(*item)
        return self.named(item)

    def look(self, item: Any) -> Material:
        """Return a material from a draw, a formula or its list."""
        while isinstance(item, str | dict):
            item = self.drawn(item)
        if isinstance(item, Material):
            return item
        values: list[Any] = [tuple(one) if isinstance(one, list) else one for one in self._listed(item)]
        return Material(values[0], shine=values[1]) if len(values) == 2 else Material(*values)

    def _listed(self, items: Any) -> Iterator[Any]:
        for item in items:
            if isinstance(item, str) and item.startswith("*"):
                yield from self.value(item[1:])
            else:
                yield self.value(item)

    def parts(self, entry: Mapping[str, Any]) -> Iterator[tuple[Mesh, Material]]:
        """Yield the parts of an entry of `parts`."""
        self.draw(entry.get("first", {}))
        if not self.value(entry.get("when", True)):
            return
        if "shape" in entry:
            for _ in self._each(entry):
                sizes = {name: self._names[name] for name in entry["sizes"]}
                yield from (
                    build(entry["shape"], self.rng, **sizes).moved(self.value(entry.get("place", "eye(4)"))).parts
                )
        elif entry.get("apart"):
            for _ in self._each(entry):
                yield self._once(entry), self.look(entry["look"])
        else:
            yield self.mesh(entry), self.look(entry["look"])

    def _each(self, entry: Mapping[str, Any]) -> Iterator[None]:
        """Bind each value of `each`, and draw before it."""
        ((name, values),) = entry.get("each", {"": "(0,)"}).items()
        for value in self.value(values):
            self._names[name] = value
            self.draw(entry.get("draw", {}))
            yield

    def mesh(self, entry: Mapping[str, Any]) -> Mesh:
        """Return the mesh of a part, once for each value of `each`."""
        made = [self._once(entry) for _ in self._each(entry)]
        return made[0] if len(made) == 1 else merged(made)

    def _once(self, entry: Mapping[str, Any]) -> Mesh:
        values = {name: self.value(item) for name, item in entry.items() if name in _ARGUMENTS}
        at = self.value(entry["at"]) if "at" in entry else None
        if "all" in entry:
            mesh = merged([self.mesh(one) for one in entry["all"]])
        else:
            kind = next(name for name in entry if name in _MESHES)
            if at is not None and kind in ("box", "rounded"):
                values["at"], at = at, None
            mesh = _MESHES[kind](self.value(entry[kind]), **values)
        if "scale" in entry:
            mesh = Mesh(mesh.vertices * self.value(entry["scale"]), mesh.faces)
        if "warp" in entry:
            mesh = Mesh(self._warped(entry["warp"], mesh.vertices), mesh.faces)
        if "noise" in entry:
            mesh = solids.displaced(mesh, self.rng, *entry["noise"])
        if "flat" in entry:
            mesh = solids.flattened(mesh, self.value(entry["flat"]))
        if at is not None:
            mesh = mesh.moved(shift(at))
        return mesh.moved(self.value(entry["place"])) if "place" in entry else mesh

    def _warped(self, formulas: Mapping[str, str], vertices: Float64Array) -> Float64Array:
        self._names.update(zip("XYZ", vertices.T, strict=True))
        for name, formula in formulas.items():
            self._names[name] = self.value(formula)
        return np.column_stack([self._names[name] for name in "XYZ"])


def _rows(builder: _Builder, of: Any) -> Float64Array:
    low, high = np.array(of[1:], np.float64).T
    return builder.rng.uniform(low, high, (builder.value(of[0]), len(low)))


def _two(builder: _Builder, of: Any) -> list[Any]:
    options = builder.named(of)
    return [options[int(k)] for k in builder.rng.choice(len(options), 2, replace=False)]


# The kinds of draws: functions of the value of the kind.
_DRAWS: Mapping[str, Callable[[_Builder, Any], Any]] = {
    "one": lambda builder, of: builder.named(choice(builder.rng, builder.named(of))),
    "two": _two,
    "list": lambda builder, of: [builder.drawn(item) for item in of],
    "rows": _rows,
    "whole": lambda builder, ends: int(builder.rng.integers(*ends)),
    "chance": lambda builder, fraction: builder.rng.random() < fraction,
    "paint": lambda builder, shine: Material(paint(builder.rng), shine=shine),
    "wood": lambda builder, scale_m: wood(builder.rng, scale_m),
    "material": lambda builder, name: material(builder.rng, name),
    "mesh": lambda builder, entry: builder.mesh(entry),
}


def material(rng: np.random.Generator, name: str) -> Material:
    """Draw a material of the table `materials`."""
    builder = _Builder(rng, {})
    builder.draw(_table()["materials"][name])
    return builder.look("look")


def build(name: str, rng: np.random.Generator, **sizes: Any) -> Model:
    """Return a model of the shape of this name; `sizes` are not drawn."""
    shapes, builder = _table()["shapes"], _Builder(rng, sizes)
    builder.draw(shapes[name])
    if "either" in shapes[name]:
        chance, first, second = shapes[name]["either"]
        name = first if rng.random() < chance else second
        builder.draw(shapes[name])
    entry = shapes[name]
    parts = [part for one in entry["parts"] for part in builder.parts(one)]
    title = entry.get("name", name.replace("_", " "))
    return Model(title, tuple(parts)) if entry.get("origin") else standing(title, *parts)


def families() -> dict[str, list[str]]:
    """Return the names of the shapes of each family."""
    names: dict[str, list[str]] = _table()["families"]
    return names


def sets() -> dict[str, list[str]]:
    """Return the names of the shapes of each set that kinds of scenes draw from."""
    names: dict[str, list[str]] = families() | _table()["sets"]
    return names
