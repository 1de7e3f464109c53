"""Queries of a map of objects, the same for finished results, a running tracker and a scene."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.errors import InputError, OutputError, shown
from cuboid.ground.core.results import MapPoints, Relation, SupportPlane, TrackedObject, Wall
from cuboid.results.files.object_table import ObjectTable

if TYPE_CHECKING:
    from cuboid.ground.core.paths import PathLike
    from cuboid.method.relations import Branch
    from cuboid.method.shapes import ObjectMesh, ObjectView
    from cuboid.method.text_search import TextMatch, TextModel


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points with colors.

    Attributes
    ----------
    xyz : (N, 3) float32
        World, metres.
    rgb : (N, 3) uint8
    """

    xyz: Float32Array
    rgb: UInt8Array

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.xyz)

    def __repr__(self) -> str:
        return f"PointCloud({len(self)} points)"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a binary PLY file, which Open3D, MeshLab, CloudCompare and Blender read; replaces the file.

        Parameters
        ----------
        path : str or os.PathLike
            Name that ends in ``.ply``.

        Raises
        ------
        OutputError
            The name does not end in ``.ply``, or the file cannot be written.
        """
        from cuboid.results.files.pending import write_whole
        from cuboid.results.files.ply import cloud_ply

        file = Path(path)
        if file.suffix.lower() != ".ply":
            raise OutputError(f"{file}: expected a name that ends in .ply")
        write_whole(file, cloud_ply(self.xyz, self.rgb))


class MapQueries(ABC):
    """A map of objects that can be queried: `Results`, `Tracker`, `SceneTracker` and `Scene` all are one.

    Answers of a running tracker are those of the frames so far; answers of a scene are those of its last commit.
    """

    @property
    @abstractmethod
    def objects(self) -> ObjectTable:
        """The objects, by label: a list, and a table for notebooks and pandas."""

    @property
    @abstractmethod
    def planes(self) -> Sequence[SupportPlane]:
        """The supporting planes; `TrackedObject.plane` is an index into them."""

    @property
    @abstractmethod
    def up(self) -> Float64Array | None:
        """Up in the world, (3,), a unit vector; None while unknown."""

    @property
    def walls(self) -> Sequence[Wall]:
        """The walls that objects may be against, the largest first; `Relation.to` names them by their index."""
        from cuboid.method.relations import find_walls

        return find_walls(self.map_points(), self.up)

    @property
    def relations(self) -> dict[int, tuple[Relation, ...]]:
        """The relations of each object to others and to surfaces, by label: those that were saved, else found now."""
        from cuboid.method.relations import find_relations

        objects = self.objects
        return saved_relations(objects) or find_relations(objects, self.planes, self.up, self.walls)

    @property
    def tree(self) -> tuple[Branch, ...]:
        """The tree of the place: surfaces, the objects on them, and the objects on and in those; from `relations`."""
        from cuboid.method.relations import place_tree

        return place_tree(self.objects, self.relations, self.planes, self.up)

    @abstractmethod
    def map_points(self) -> MapPoints:
        """Return the global point map."""

    def cloud(self, label: int) -> PointCloud:
        """Return the points of one object.

        Parameters
        ----------
        label : int
            Its label, or one that was merged into it.

        Returns
        -------
        PointCloud
            World, metres.

        Raises
        ------
        InputError
            No object of the map has the label.
        """
        points = self.map_points().of_object(self.objects.find(label).label)
        return PointCloud(points.xyz, points.rgb)

    def mesh(self, label: int, *, close: bool = False, complete: bool = False) -> ObjectMesh:
        """Return the surface of one object, fused from the depth of its views.

        Parameters
        ----------
        label : int
            Its label, or one that was merged into it.
        close : bool
            Extend its sides down to its support, and close its foot.
        complete : bool
            Close all holes, the foot too: within its box, space that no view saw empty is solid.

        Returns
        -------
        ObjectMesh
            World, metres; `guessed` marks the vertices that no view measured. No faces if no view shows the object.

        Raises
        ------
        InputError
            No object of the map has the label, or there are no views of it.
        MissingExtraError
            scikit-image is not installed.
        """
        from cuboid.method.shapes import object_mesh

        item = self.objects.find(label)
        views = self._views(item)
        return object_mesh(item, views, self.planes, self.map_points(), close=close, complete=complete)

    def find(self, text: str, model: PathLike | TextModel | None = None) -> list[TextMatch]:
        """Return the objects ranked by how well their pictures fit a text, the best first.

        Parameters
        ----------
        text : str
            For example "something to drink from".
        model : path or TextModel, optional
            Folder of an image-text model; default: that of the environment variable ``CUBOID_TEXT_MODEL``.

        Raises
        ------
        InputError
            There is no such model, the text is empty, or there are no pictures of the objects.
        MissingExtraError
            ONNX Runtime or tokenizers is not installed.
        """
        from cuboid.method.text_search import open_text_model, ranked

        opened = open_text_model(model, "find")
        query = opened.query(text)
        return ranked(self.objects, self.vectors(opened), query)

    def vectors(self, model: TextModel) -> Mapping[int, Float32Array]:
        """Return the unit vectors (D,) of the objects by an image-text model, by label.

        An object without views has none.

        Raises
        ------
        InputError
            The model cannot be run, or there are no pictures of the objects.
        MissingExtraError
            ONNX Runtime is not installed.
        """
        from cuboid.method.text_search import embed_views
        from cuboid.method.text_search.pictures import PICTURED_VIEWS

        found = {item.label: embed_views(model, self._views(item, PICTURED_VIEWS), item.box) for item in self.objects}
        return {label: vector for label, vector in found.items() if vector is not None}

    def _views(self, item: TrackedObject, max_views: int | None = None) -> list[ObjectView]:
        """Return at most `max_views` views of an object; raise InputError if no views are stored."""
        raise InputError(f"{type(self).__name__} keeps no views of its objects")

    def near(self, point: npt.ArrayLike, within_m: float) -> ObjectTable:
        """Return the objects near a point, nearest first.

        Parameters
        ----------
        point : (3,) array_like
            World, metres.
        within_m : float
            Largest distance of a box from the point, metres; a box that contains the point has distance 0.

        Raises
        ------
        InputError
            The point is not three finite numbers, or the distance is negative or no number.
        """
        place = _point(point)
        if not within_m >= 0:
            raise InputError(f"expected a distance of at least 0 metres, got {shown(within_m)}")
        found = [(item.box.distance_m(place), item.label, item) for item in self.objects]
        return ObjectTable(item for distance, _, item in sorted(found, key=lambda row: row[:2]) if distance <= within_m)

    def on(self, plane: int) -> ObjectTable:
        """Return the objects with the relation "on" to a supporting plane, by label.

        An object that stands on or in another one has that relation to the other one alone.

        Parameters
        ----------
        plane : int
            Index into `planes`.

        Raises
        ------
        InputError
            There is no such plane.
        """
        count = len(self.planes)
        if not 0 <= plane < count:
            expected = f"0 to {count - 1}" if count else "none, since no plane is known"
            raise InputError(f"there is no plane {shown(plane)}; expected {expected}")
        from cuboid.method.relations import find_relations

        objects, to = self.objects, f"plane:{plane}"
        relations = saved_relations(objects) or find_relations(objects, self.planes, self.up)
        return ObjectTable(
            item for item in objects if any(one.kind == "on" and one.to == to for one in relations[item.label])
        )


def saved_relations(objects: Sequence[TrackedObject]) -> dict[int, tuple[Relation, ...]]:
    """Return the relations that were saved with objects, by label; an empty dict if there are none."""
    return {item.label: item.relations for item in objects} if any(item.relations for item in objects) else {}


def _point(point: npt.ArrayLike) -> Float64Array:
    """Return a point as (3,) float64; raise InputError if it is none."""
    try:
        place = np.asarray(point, np.float64)
    except (TypeError, ValueError):
        place = np.zeros(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(f"expected a point as three finite numbers (x, y, z in metres), got {shown(point)}")
    return place
