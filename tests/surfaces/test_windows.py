"""The table of planes against a search through all."""

from __future__ import annotations

import numpy as np

from cuboid.method.surfaces.plane import Plane
from cuboid.method.surfaces.windows import Windows


def test_what_is_asked_of_all_planes_is_what_each_one_says() -> None:
    rng = np.random.default_rng(4)
    windows, planes = Windows(10), []
    for k in range(60):
        plane = Plane(index=k, last_frame=k, in_use=k % 3 > 0, weight=float(rng.integers(1, 9)))
        plane.mean = rng.uniform(-5, 5, 3) * (1, 1, 0.02)
        plane.plan.begin(plane.mean[None], np.array([0.5]))
        windows.update(plane)
        planes.append(plane)
    box = np.array([-10, -30, 25, 40])
    apart = [(p.plan.window[:2] >= box[2:]).any() or (p.plan.window[2:] <= box[:2]).any() for p in planes]
    assert windows.within(box) == [k for k in range(60) if not apart[k]]
    assert windows.expired(40) == [k for k in range(30) if k % 3 == 0]
    heaviest = max(p.weight for p in planes if p.in_use)
    assert windows.heaviest() == next(p.index for p in planes if p.in_use and p.weight == heaviest)
    near = [k for k in windows.within(planes[7].plan.window) if k != 7]
    level = [k for k in near if abs(float(planes[7].height(planes[k].mean[None])[0])) <= 0.05]
    assert windows.level_with(planes[7], 0.05) == level
    windows.retain([5, 7, 9])
    planes[7].index = 1
    assert 1 in windows.within(planes[7].plan.window)
    assert len(windows.within(np.array([-999, -999, 999, 999]))) == 3
