"""The objects of one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.runs.tracking.tracker import Tracker

if TYPE_CHECKING:
    from cuboid.method.proposals.types import ProposalSource
    from cuboid.results.files.object_table import ObjectTable


def detect(
    color: UInt8Array,
    depth_m: Float32Array,
    intrinsics: Intrinsics,
    *,
    T_world_camera: Float64Array | None = None,
    config: TrackerConfig | None = None,
    proposals: str | ProposalSource | None = None,
) -> ObjectTable:
    """Return the objects of one picture; `cuboid detect` finds the same ones.

    Parameters
    ----------
    color : (H, W, 3) uint8
        RGB.
    depth_m : (H, W) float32
        Depth along the optical axis, aligned to color, in metres; 0 is no reading.
    intrinsics : Intrinsics
    T_world_camera : (4, 4) float64, optional
        Pose of the camera; by default the boxes are in camera coordinates (x right, y down, z forward).
    config : TrackerConfig, optional
    proposals : str or ProposalSource, optional
        As for `Tracker`.

    Returns
    -------
    ObjectTable
        Each object has its box, label and probability. Sides that the picture does not show are assumed; more views,
        see `Tracker`, make boxes exact and probabilities surer.

    Raises
    ------
    FrameError
        If the images do not have the size of the intrinsics, or are invalid.
    InputError
        If no proposal source has that name.

    Examples
    --------
    >>> camera = cuboid.Intrinsics(525.0, 525.0, 319.5, 239.5, 640, 480)  # doctest: +SKIP
    >>> for thing in cuboid.detect(color, depth_m, camera):  # doctest: +SKIP
    ...     print(thing.label, thing.box.center, thing.box.size, thing.probability)
    """
    tracker = Tracker(intrinsics, config, proposals)
    pose = np.eye(4) if T_world_camera is None else T_world_camera
    tracker.update(Frame(0, 0.0, color, depth_m, pose))
    return tracker.objects
