from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.lab.synthetic.noise_models import STEP_PER_M
from cuboid.lab.synthetic.sensor_effects import Seen, projector_shadow
from cuboid.lab.synthetic.sensors import SENSORS

CAMERA = Intrinsics(540.0, 540.0, 159.5, 119.5, 320, 240)
SHAPE = (240, 320)


DEVICES = ("kinect-v1", "realsense-d435", "azure-kinect", "iphone-lidar")


def measure(name, depth, cosine=1.0, seed=0, albedo=0.6, shine=0.0):
    shape = np.shape(depth) or SHAPE
    full = (np.broadcast_to(np.float32(value), shape).copy() for value in (depth, cosine, albedo, shine))
    return SENSORS[name](Seen(*full), CAMERA, np.random.default_rng(seed))


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


@pytest.mark.parametrize("name", DEVICES[:3])
def test_dark_and_mirroring_surfaces_are_holes(name):
    """All columns right of the band that the second camera or the projector does not reach."""
    at = np.s_[10:-10, 60:-10]
    assert (measure(name, 1.0)[at] > 0).mean() > 0.97
    assert (measure(name, 2.2, albedo=0.003)[at] > 0).mean() < 0.25
    assert (measure(name, 1.0, shine=0.9)[at] > 0).mean() < 0.1
    assert (measure(name, 1.0, np.cos(np.radians(40)), shine=0.9)[at] > 0).mean() > 0.97
    blobs = (measure(name, 2.0, albedo=0.052 if name == "kinect-v1" else 0.028)[at] == 0).astype(float)
    assert 0.05 < blobs.mean() < 0.98
    assert np.corrcoef(blobs[:, 1:].ravel(), blobs[:, :-1].ravel())[0, 1] > 0.3, "holes are blobs, not single pixels"


def test_stereo_deviates_as_published_and_sees_texture():
    """z^2 * 0.08 px / (447 px * 0.05 m); where the pattern is too weak, the texture of the surface helps."""
    for z in (0.7, 1.5):
        errors = measure("realsense-d435", z)[20:-20, 60:] - z
        np.testing.assert_allclose(errors.std(), 0.08 * z * z / (447 * 0.05), rtol=0.15)
    rng = np.random.default_rng(2)
    dark, printed = np.full(SHAPE, 0.02), np.where(rng.random(SHAPE) < 0.5, 0.0, 0.3)
    seen = [(measure("realsense-d435", 3.0, albedo=albedo)[20:-20, 60:-20] > 0).mean() for albedo in (dark, printed)]
    assert seen[0] < 0.25
    assert seen[1] > 0.95


def test_stereo_has_bands_without_readings_and_grown_edges():
    """The band is f b (1/1 - 1/2) = 540 * 0.05 / 2 = 13 columns; at the left border it is f b / 2 = 13."""
    seen = measure("realsense-d435", step_scene())
    assert not seen[:, :12].any()
    assert ((seen[80:160] == 0).mean(axis=0)[138:149] > 0.7).all()
    grown = (seen[80:160, 220:222] > 0.9) & (seen[80:160, 220:222] < 1.1)
    assert 0.05 < grown.mean() < 0.95, "the near body grows over its right edge in places"


def test_the_depth_of_kinect_is_displaced_and_that_of_the_phone_is_soft():
    kinect, light = measure("kinect-v1", step_scene()), measure("structured-light", step_scene())
    both = (kinect[:, 1:-4] > 0) & (light[:, :-5] > 0)
    np.testing.assert_array_equal(kinect[:, 1:-4][both], light[:, :-5][both])
    assert both.mean() > 0.8
    assert not kinect[:, :1].any()
    assert not kinect[:, -3:].any()
    phone = measure("iphone-lidar", step_scene())
    assert (phone > 0).all()
    edge = phone[80:160, 210:230].mean(axis=0)
    assert ((edge > 1.1) & (edge < 1.9)).sum() >= 2
    assert np.abs(phone[80:160, 165:205] - 1).max() < 0.03


def test_flying_pixels_of_azure_lie_between_and_many_are_lost():
    seen = measure("azure-kinect", step_scene())[80:160, 217:223]
    assert 0.2 < (seen == 0).mean() < 0.9
    assert ((seen > 1.1) & (seen < 1.9)).any()
    noise = [measure("azure-kinect", 2.0, albedo=albedo)[:, 60:] for albedo in (0.8, 0.2)]
    assert noise[1][noise[1] > 0].std() > 1.5 * noise[0].std(), "the weaker the signal, the stronger the noise"
