"""Evaluation of the heat of the point map against a labelled point cloud."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.reading import MAX_BINARY_BYTES, opened
from cuboid.ground.formats.rows_files import LabelEntry
from cuboid.ground.formats.table_validation import read_lines
from cuboid.ground.geometry.overlap import pack
from cuboid.ground.geometry.se3 import MAX_FROM_ORIGIN_M
from cuboid.lab.evaluation.average_precision import average_precision
from cuboid.lab.evaluation.matching import ratio
from cuboid.lab.evaluation.truth import Truth

# Maximum distance between a labelled point and the map point from which it takes its heat, metres: two voxels of 1 cm.
HEAT_REACH_M = 0.02
# Objects among the classes of RGB-D Scenes v2: bowl, cap, cereal box, coffee mug, soda can; the others are
# coffee table, office chair, sofa, table, background.
UW_OBJECT_CLASSES = (1, 2, 3, 4, 7)
CURVE_HEATS = np.arange(1, 21) * 0.05
# Boxes are enlarged by this on each side for tests of which points lie inside, metres.
SKIN_M = 0.001


@dataclass(frozen=True, slots=True)
class LabelledCloud:
    """Points that are labelled as on an object or not.

    Attributes
    ----------
    xyz : (N, 3) float64
        In the world of the truth, metres.
    on_object : (N,) bool
    """

    xyz: Float64Array
    on_object: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class HeatAt:
    """Precision and recall of the rule that points of at least this heat belong to objects.

    Attributes
    ----------
    heat : float
    precision : float or None
        None if no point is as hot.
    recall, f : float or None
    """

    heat: float
    precision: float | None
    recall: float | None
    f: float | None


@dataclass(frozen=True, slots=True)
class HeatQuality:
    """Quality of heat as a classifier of object points.

    Attributes
    ----------
    points, object_points : int
        Judged points of the labelled cloud, and those on objects.
    mapped : float or None
        Fraction of judged points with a map point nearby; the others count as heat 0.
    ap : float or None
        Average precision over all heats.
    best : HeatAt or None
        The point of the curve with the largest F-measure (beta = 1).
    curve : tuple of HeatAt
        At heats from 0.05 to 1.
    """

    points: int
    object_points: int
    mapped: float | None
    ap: float | None
    best: HeatAt | None
    curve: tuple[HeatAt, ...]


def read_labelled_cloud(path: PathLike) -> LabelledCloud:
    """Read a labelled cloud.

    Parameters
    ----------
    path : Path
        A PLY whose points have a `label` (0 is no object), as `cuboid synth` writes, or one with a `.label` file of
        RGB-D Scenes v2 beside it: the number of points, then the class of each.

    Raises
    ------
    InputError
        A file is missing or malformed, or the points have no labels.
    """
    trimesh = require("trimesh", "cuboid evaluate --cloud", "synth")
    path = as_path(path)

    with opened(path, MAX_BINARY_BYTES) as file:
        try:
            vertex = trimesh.load(file, file_type="ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
            xyz = np.stack([np.ravel(vertex[name]) for name in "xyz"], axis=1).astype(np.float64)
            names = vertex.dtype.names if isinstance(vertex, np.ndarray) else tuple(vertex)
        except Exception as error:  # the library has no error class for files that are no PLY
            raise InputError(f"{path}: is no PLY of points: {error}") from error
    if not (np.abs(xyz) <= MAX_FROM_ORIGIN_M).all():
        raise InputError(f"{path}: a point is NaN, infinite, or more than {MAX_FROM_ORIGIN_M:g} m away")
    label_file = path.with_suffix(".label")
    if label_file.is_file():
        return LabelledCloud(xyz, np.isin(_classes(label_file, len(xyz)), UW_OBJECT_CLASSES))
    if "label" not in names:
        raise InputError(f"{path}: expected points with a label, or {label_file.name} beside it")
    return LabelledCloud(xyz, np.ravel(vertex["label"]) > 0)


def _classes(path: Path, points: int) -> npt.NDArray[np.int64]:
    values = [row.number for _, row in read_lines(path, LabelEntry)]
    if len(values) != points + 1 or values[0] != points:
        raise InputError(f"{path}: expected {points} and as many classes, got {len(values)} numbers")
    return np.array(values[1:])


def heat_quality(xyz: Float64Array, heat: npt.NDArray[np.floating], cloud: LabelledCloud, truth: Truth) -> HeatQuality:
    """Compare the heat of a map with a labelled cloud.

    Parameters
    ----------
    xyz : (N, 3) float64
        Points of the map, in the world of the truth.
    heat : (N,) float
        0..1.
    cloud : LabelledCloud
    truth : Truth
        Points outside its judged region, in ignored places, or on objects that are not judged are left out.

    Notes
    -----
    Precision, recall and F-measure over a threshold on an objectness map, as in Achanta, Hemami, Estrada,
    Susstrunk, "Frequency-tuned Salient Region Detection", CVPR 2009, here on points and with beta = 1; average
    precision as for boxes.
    """
    judged = ~_aside(cloud.xyz, truth)
    spots, hot = cloud.xyz[judged], cloud.on_object[judged]
    value, near = _nearest_heat(xyz, heat, spots)
    total, warm = int(hot.sum()), value > 0
    curve = tuple(_at(float(bound), hot[value >= bound], total) for bound in CURVE_HEATS)
    return HeatQuality(
        points=len(spots),
        object_points=total,
        mapped=ratio(int(near.sum()), len(spots)),
        ap=average_precision(value[warm], hot[warm], total),
        best=max((at for at in curve if at.f is not None), key=lambda at: at.f or 0.0, default=None),
        curve=curve,
    )


def _nearest_heat(
    xyz: Float64Array, heat: npt.NDArray[np.floating], spots: Float64Array
) -> tuple[Float64Array, npt.NDArray[np.bool_]]:
    """Return the heat at spots (M, 3), 0 where no map point is near, and whether one is near."""
    if not (len(xyz) and len(spots)):
        return np.zeros(len(spots)), np.zeros(len(spots), bool)
    nearest = np.asarray(KDTree(xyz).query(spots, distance_upper_bound=HEAT_REACH_M)[1])
    near = nearest < len(xyz)
    return np.append(heat, 0.0)[nearest], near  # spots without a neighbour have the index after the last point


def _at(heat: float, taken: npt.NDArray[np.bool_], total: int) -> HeatAt:
    """Return the scores of the points that are taken, each on an object or not, (N,)."""
    right = int(taken.sum())
    f = ratio(2 * right, len(taken) + total) if total else None
    return HeatAt(heat, ratio(right, len(taken)), ratio(right, total), f)


def _aside(points: Float64Array, truth: Truth) -> npt.NDArray[np.bool_]:
    """Return for each point whether it is not judged, (N,)."""
    aside = np.zeros(len(points), bool)
    if truth.region is not None:
        aside = ~truth.region.contains(points)
    for row in pack([*truth.ignored, *(item.box for item in truth.objects if not item.judged)]):
        local = (points - row[:3]) @ row[6:].reshape(3, 3)
        aside |= (np.abs(local) <= row[3:6] / 2 + SKIN_M).all(1)
    return aside
