from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.lab.synthetic.sensors import SENSORS, STEP_PER_M, projector_shadow

CAMERA = Intrinsics(540.0, 540.0, 159.5, 119.5, 320, 240)
SHAPE = (240, 320)


def measure(name, depth, cosine=1.0, seed=0):
    shape = np.shape(depth) or SHAPE
    full = np.broadcast_to(np.float32(depth), shape).copy()
    return SENSORS[name](full, np.full(shape, cosine, np.float32), CAMERA, np.random.default_rng(seed))


@pytest.mark.parametrize("z", [0.7, 1.5, 3.0])
def test_structured_light_deviates_as_published(z):
    """Khoshelham and Oude Elberink 2012: 1.425e-3 z^2, the rounding to steps included."""
    depths = np.linspace(z, z * 1.02, SHAPE[1], dtype=np.float32) * np.ones(SHAPE, np.float32)
    errors = (measure("structured-light", depths) - depths)[:, 60:]  # left of it no projector reaches
    kept = errors[np.abs(errors) < z / 2]
    assert len(kept) > 0.98 * errors.size
    assert abs(kept.mean()) < 0.1 * kept.std()
    np.testing.assert_allclose(kept.std(), 1.425e-3 * (z * 1.01) ** 2, rtol=0.05)


def test_structured_light_measures_in_steps_of_disparity():
    seen = measure("structured-light", 1.7)
    steps = 1 / seen[seen > 0] / STEP_PER_M
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-3)
    assert len(np.unique(np.rint(steps))) < 8


def test_noise_of_neighbours_is_alike():
    seen = measure("structured-light", 2.0)
    errors = np.where(seen > 0, seen - 2.0, 0)
    near = np.corrcoef(errors[10:-10, 70:-1].ravel(), errors[10:-10, 71:].ravel())[0, 1]
    far = np.corrcoef(errors[10:-10, 70:-9].ravel(), errors[10:-10, 79:].ravel())[0, 1]
    assert near > 0.2
    assert abs(far) < 0.1


@pytest.mark.parametrize(("z", "degrees"), [(1.0, 0.0), (2.0, 45.0), (4.0, 60.0)])
def test_time_of_flight_deviates_as_published(z, degrees):
    """Fankhauser et al. 2015, in millimetres: 1.5 - 0.5 z + 0.3 z^2 + 0.1 z^1.5 t^2 / (pi/2 - t)^2."""
    t = np.radians(degrees)
    expected = 1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * t**2 / (np.pi / 2 - t) ** 2
    seen = measure("time-of-flight", z, np.cos(t))
    np.testing.assert_allclose(seen[seen > 0].std() * 1000, expected, rtol=0.03)


def test_clean_is_exact_and_far_is_nothing():
    np.testing.assert_array_equal(measure("clean", 1.234), np.float32(1.234))
    assert not measure("clean", 20.0).any()
    assert not measure("structured-light", 0.3).any()
    assert not measure("time-of-flight", 6.0).any()


@pytest.mark.parametrize("name", ["structured-light", "time-of-flight"])
def test_grazing_surfaces_are_holes(name):
    assert (measure(name, 1.5, np.cos(np.radians(60)))[:, 60:] > 0).mean() > 0.99
    fraction = (measure(name, 1.5, np.cos(np.radians(80)))[:, 60:] > 0).mean()
    assert 0.3 < fraction < 0.7
    assert not measure(name, 1.5, np.cos(np.radians(87))).any()


def step_scene():
    depth = np.full(SHAPE, 2.0, np.float32)
    depth[60:180, 150:220] = 1.0
    return depth


def test_a_near_body_shades_what_lies_left_behind_it():
    """Right of the camera stands the projector: f b (1/1 - 1/2) = 540 * 0.075 / 2 = 20 columns have no light."""
    seen = measure("structured-light", step_scene())
    lost = (seen[80:160] == 0).mean(axis=0)
    assert (lost[131:149] > 0.95).all()
    assert lost[100:125].mean() < 0.05
    assert lost[160:210].mean() < 0.05
    assert lost[225:].mean() < 0.05


def plain_shadow(depth, disparity_at_1_m):
    """Say of each pixel, one by one, whether the line between two nearer neighbours covers it."""
    shadow = np.zeros(depth.shape, bool)
    for r in range(depth.shape[0]):
        d = np.where(depth[r] > 0, disparity_at_1_m / np.maximum(depth[r], 1e-6), np.nan)
        at = np.arange(depth.shape[1]) - d
        joined = np.abs(np.diff(d)) <= 1
        for c in np.flatnonzero(depth[r] > 0):
            k = np.rint(at[c])
            covered = joined & (np.ceil(at[:-1]) <= k) & (k <= np.floor(at[1:]))
            nearer = np.maximum(d[:-1], d[1:]) > d[c] + 1.5
            shadow[r, c] = k >= 0 and bool((covered & nearer).any())
    return shadow


def test_shadow_kernel_equals_its_plain_form():
    rng = np.random.default_rng(4)
    depth = np.repeat(np.repeat(rng.uniform(0.6, 3, (6, 10)), 2, axis=0), 9, axis=1).astype(np.float32)
    depth *= np.linspace(1, 1.1, depth.shape[1], dtype=np.float32)
    depth[rng.random(depth.shape) < 0.1] = 0
    shadow = np.zeros(depth.shape, bool)
    projector_shadow(depth, 40.0, shadow)
    np.testing.assert_array_equal(shadow, plain_shadow(depth, 40.0))
    assert 0.02 < shadow.mean() < 0.8


def test_edges_are_ragged_and_flying_pixels_lie_between():
    light = measure("structured-light", step_scene())
    near = (light[80:160, 215:226] > 0) & (light[80:160, 215:226] < 1.5)
    assert 0.05 < near[:, 5:8].mean() < 0.95, "the edge at column 220 is not straight"
    flight = measure("time-of-flight", step_scene())
    between = (flight > 1.1) & (flight < 1.9)
    assert between[80:160, 148:152].any()
    assert not between[80:160, 160:210].any()


def test_same_seed_same_depth():
    for name in SENSORS:
        np.testing.assert_array_equal(measure(name, step_scene()), measure(name, step_scene()))
        if name != "clean":
            assert (measure(name, step_scene()) != measure(name, step_scene(), seed=1)).any()
