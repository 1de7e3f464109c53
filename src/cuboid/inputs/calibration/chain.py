"""First poses of the cameras of a rig: each camera is placed by one that is placed already."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError


def chained(
    names: Sequence[str], places: Callable[[int, int], Iterable[tuple[float, Float64Array]]], reason: str
) -> Float64Array:
    """Return T_rig_camera (N, 4, 4) of N cameras; the first is the rig. The best of all pairs comes first each time.

    Parameters
    ----------
    names : sequence of str
        Names of the cameras, for the message.
    places : callable
        Returns scores, the higher the better, and T_a_b (4, 4) of the cameras `a` and `b`, by number.
    reason : str
        Why cameras have no place.

    Raises
    ------
    InputError
        A camera has no place relative to the others.
    """
    T_rig_camera: dict[int, Float64Array] = {0: np.eye(4)}
    while others := [k for k in range(len(names)) if k not in T_rig_camera]:
        found = [(score, a, b, T) for a in T_rig_camera for b in others for score, T in places(a, b)]
        if not found:
            raise InputError(f"camera {', '.join(names[k] for k in others)}: {reason}")
        _, a, b, T = max(found, key=lambda one: one[0])
        T_rig_camera[b] = T_rig_camera[a] @ T
    return np.array([T_rig_camera[k] for k in range(len(names))])
