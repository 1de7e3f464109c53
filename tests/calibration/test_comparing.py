from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.geometry import se3
from cuboid.inputs.calibration.comparing import PARAMETERS, disagreements, warp
from cuboid.inputs.calibration.views import GRADIENT_CELL_PX, ScaledPinhole, View, build_view, factors

PINHOLE = ScaledPinhole(130.0, 128.0, 79.0, 61.0)
T_OTHER_VIEW = se3.exp([0.05, -0.03, 0.04, 0.05, -0.08, 0.03])


def smooth_view(seed: int) -> View:
    """Depth and contrast that change gently, so that a numeric derivative is one."""
    y, x = np.mgrid[0:120, 0:160].astype(np.float64)
    a, b, c, d = np.random.default_rng(seed).uniform(0.02, 0.05, 4)
    depth_m = 1.5 + 0.15 * np.sin(a * x + seed) + 0.15 * np.cos(b * y)
    contrast = np.sin(c * x + d * y) + np.cos(d * x - c * y)
    rows, columns = (grid.ravel() for grid in np.mgrid[8:112:7, 8:152:7])
    xyz = np.stack([columns, rows, depth_m[rows, columns]], 1).astype(float)
    smooth = np.ones(depth_m.shape, bool)
    return View(
        seed, np.eye(4), contrast.astype(np.float32), depth_m.astype(np.float32), smooth, xyz, contrast[rows, columns]
    )


def stepped(pinhole: ScaledPinhole, parameter: int, step: float) -> tuple[ScaledPinhole, float]:
    """Return the pinhole after a step of a parameter, and the depth scale."""
    grown = np.exp(step)
    if parameter == 0:
        return replace(pinhole, fx=pinhole.fx * grown, fy=pinhole.fy * grown), 1.0
    if parameter == 1:
        return replace(pinhole, cx=pinhole.cx + step), 1.0
    if parameter == 2:
        return replace(pinhole, cy=pinhole.cy + step), 1.0
    return pinhole, float(grown)


def values(view: View, other: View, T: np.ndarray, pinhole: ScaledPinhole, depth_scale: float = 1.0) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] /= depth_scale
    found = warp(view, other, moved, pinhole)
    return np.stack([found.gap_m, found.change])


def assert_close(numeric: np.ndarray, analytic: np.ndarray) -> None:
    """Bilinear images have kinks between pixels: nearly all must agree, to a few hundredths."""
    off = np.abs(numeric - analytic) / (np.abs(analytic).max() + 1e-9)
    assert np.quantile(off, 0.95) < 0.03


@pytest.mark.parametrize("parameter", range(PARAMETERS))
def test_derivatives_by_the_parameters(parameter: int) -> None:
    view, other, step = smooth_view(1), smooth_view(2), 1e-4 if parameter in (0, 3) else 1e-3
    base = warp(view, other, T_OTHER_VIEW, PINHOLE)
    depth, contrast = disagreements(base, T_OTHER_VIEW, PINHOLE, T_OTHER_VIEW[:3, 3])
    sides = []
    for sign in (1, -1):
        pinhole, depth_scale = stepped(PINHOLE, parameter, sign * step)
        sides.append(values(view, other, T_OTHER_VIEW, pinhole, depth_scale))
    numeric = (sides[0] - sides[1]) / (2 * step)
    assert_close(numeric[0], depth.by_parameter[:, parameter] * base.noise_m)
    assert_close(numeric[1][base.same], contrast.by_parameter[:, parameter])


@pytest.mark.parametrize("axis", range(6))
def test_derivatives_by_the_motion(axis: int) -> None:
    view, other, step = smooth_view(3), smooth_view(4), 1e-5
    base = warp(view, other, T_OTHER_VIEW, PINHOLE)
    depth, contrast = disagreements(base, T_OTHER_VIEW, PINHOLE, np.zeros(3))
    twist = np.zeros(6)
    twist[axis] = step
    ahead = values(view, other, se3.exp(twist) @ T_OTHER_VIEW, PINHOLE)
    back = values(view, other, se3.exp(-twist) @ T_OTHER_VIEW, PINHOLE)
    numeric = (ahead - back) / (2 * step)
    assert_close(numeric[0], depth.by_motion[:, axis] * base.noise_m)
    assert_close(numeric[1][base.same], contrast.by_motion[:, axis])


def test_a_view_agrees_with_itself() -> None:
    view = smooth_view(1)
    found = warp(view, view, np.eye(4), PINHOLE)
    assert len(found.gap_m) > 0.9 * len(view.xyz)
    np.testing.assert_allclose(found.gap_m, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.change, 0.0, atol=1e-6)


def test_what_falls_outside_behind_or_on_an_edge_is_left_out() -> None:
    view = smooth_view(1)
    away = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert len(warp(view, view, away, PINHOLE).gap_m) == 0
    edged = replace(view, smooth=np.zeros_like(view.smooth))
    assert len(warp(view, edged, np.eye(4), PINHOLE).gap_m) == 0


def test_points_are_taken_where_depth_is_smooth_and_brightness_changes() -> None:
    rng = np.random.default_rng(0)
    depth_m = np.full((240, 320), 1.0, np.float32)
    depth_m[:, 160:] = 1.5
    depth_m[:40] = 0.0
    color = np.repeat(rng.integers(0, 255, (240, 320, 1), np.uint8), 3, axis=2)
    view = build_view(Frame(0, 0.0, color, depth_m, np.eye(4)), 2)
    columns, rows = view.xyz[:, 0], view.xyz[:, 1]
    assert rows.min() >= 20
    assert not np.any(columns == 79)
    assert set(np.unique(view.xyz[:, 2])) <= {1.0, 1.5}
    cells = {(int(y) // GRADIENT_CELL_PX, int(x) // GRADIENT_CELL_PX) for x, y in zip(columns, rows, strict=True)}
    assert len(cells) == len(view.xyz)


@pytest.mark.parametrize(("width", "expected"), [(80, (1, 1)), (320, (2, 1)), (640, (4, 2)), (1280, (4, 4))])
def test_images_of_any_size_are_made_about_equally_small(width: int, expected: tuple[int, int]) -> None:
    assert factors(width) == expected


def test_a_pinhole_of_smaller_images_is_that_of_the_intrinsics() -> None:
    whole = Intrinsics(500.0, 510.0, 321.0, 241.5, 640, 480)
    small = whole.downscaled(4)
    assert ScaledPinhole.of(whole).resized(4) == ScaledPinhole(small.fx, small.fy, small.cx, small.cy)
    assert ScaledPinhole.of(whole).resized(4).resized(1 / 4) == ScaledPinhole.of(whole)
