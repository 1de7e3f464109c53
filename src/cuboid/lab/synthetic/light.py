"""Light of a scene and its color camera: lamps, ambient light, exposure, white balance, vignetting."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.lab.synthetic.material import Color

# A lamp's light at a distance of 1 m, which falls with the square of the distance, and its maximum.
STRENGTH, MAX_LIGHT = 4.8, 1.3


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A lamp or a window.

    Attributes
    ----------
    points : (L, 3) float64
        Points of the lamp, in the room: the farther apart, the softer the shadows.
    color : (r, g, b)
        Factor of the strength, linear.
    strength, max_light : float
        Light at a distance of 1 m, and the maximum at smaller distances.
    """

    points: Float64Array
    color: Color = (1.0, 1.0, 1.0)
    strength: float = STRENGTH
    max_light: float = MAX_LIGHT


@dataclass(frozen=True, slots=True)
class Light:
    """The light of a scene.

    Attributes
    ----------
    lamps : tuple of Lamp
    down, up : (r, g, b)
        Ambient light on a surface that faces down, and on one that faces up, linear.
    """

    lamps: tuple[Lamp, ...] = (Lamp(np.array([[1.0, -0.7, 2.55], [0.65, -0.5, 2.6], [0.75, -0.95, 2.6]])),)
    down: Color = (0.27, 0.27, 0.27)
    up: Color = (0.42, 0.42, 0.42)

    def moved(self, by: Float64Array) -> Self:
        """Return the light with all lamps displaced by (3,) metres."""
        return replace(self, lamps=tuple(replace(lamp, points=lamp.points + by) for lamp in self.lamps))


@dataclass(frozen=True, slots=True)
class ColorCamera:
    """The color camera.

    Attributes
    ----------
    gain : (r, g, b)
        Exposure times white balance.
    drift : float
        Maximum relative change of the gain in a scene, as by auto exposure.
    period_frames, phase : float
        Duration of one change, and its begin, radians.
    vignetting : float
        Loss of light in the corners, 0..1.
    saturation : float
        1 keeps colors, 0 makes them grey.
    blur_px : float
        Blur of the lens, pixels; it also smooths the aliasing of one ray per pixel.
    noise, color_noise : float
        Deviation of the noise that the channels share, and of each channel's own, grey levels.
    """

    gain: Color = (1.0, 1.0, 1.0)
    drift: float = 0.0
    period_frames: float = 100.0
    phase: float = 0.0
    vignetting: float = 0.0
    saturation: float = 1.0
    blur_px: float = 0.55
    noise: float = 1.6
    color_noise: float = 0.0

    def gain_at(self, frame: int) -> Float64Array:
        """Return the gain of the channels (3,) in a frame."""
        turn = 2 * np.pi * frame / self.period_frames + self.phase
        exposure = 1 + self.drift * (0.7 * np.sin(turn) + 0.3 * np.sin(2.7 * turn))
        warmth = 0.25 * self.drift * np.sin(0.6 * turn + 1)
        gain: Float64Array = np.array(self.gain) * exposure * (1 + warmth * np.array([1, 0, -1]))
        return gain


# Factors of red and blue by color temperature: those of a black body at 2700 K, 4000 K, 6500 K and of a blue sky at
# about 9000 K in sRGB, which white balance of a camera removes in part.
_TEMPERATURES: tuple[Color, ...] = ((1.3, 0.98, 0.55), (1.14, 1.0, 0.8), (1.0, 1.0, 1.0), (0.88, 0.98, 1.2))


def draw_light(rng: np.random.Generator, half_m: float) -> Light:
    """Draw lamps, a window, or both; `half_m` is the distance from the middle of the room to its walls."""
    warm, cold = (_TEMPERATURES[int(rng.integers(*ends))] for ends in ((0, 3), (1, 4)))
    kind = int(rng.integers(4))
    if kind == 0:  # one ceiling lamp
        lamps = [_ceiling(rng, 3, warm, rng.uniform(3.5, 5.5))]
    elif kind == 1:  # a window, and a dim lamp
        lamps = [
            _window(rng, half_m, cold, rng.uniform(3.5, 6.0)),
            _ceiling(rng, 1, warm, rng.uniform(0.8, 1.8)),
        ]
    elif kind == 2:  # two lamps
        lamps = [_ceiling(rng, 2, warm, rng.uniform(2.0, 3.5)), _ceiling(rng, 1, warm, rng.uniform(1.0, 2.5))]
    else:  # a spotlight with hard shadows, and a window
        lamps = [
            _ceiling(rng, 1, warm, rng.uniform(2.5, 5.0)),
            _window(rng, half_m, cold, rng.uniform(1.0, 2.5)),
        ]
    ambient = np.array(cold if kind in (1, 3) else warm) * rng.uniform(0.2, 0.42)
    return Light(tuple(lamps), _color(ambient * rng.uniform(0.5, 0.8)), _color(ambient))


def draw_camera(rng: np.random.Generator, light: Light) -> ColorCamera:
    """Draw a camera, whose white balance removes most of the color of a light."""
    lamps = sum(np.array(lamp.color) * min(lamp.strength / 4.5, lamp.max_light) for lamp in light.lamps)
    seen = np.array(light.up) + lamps
    removed = rng.uniform(0.45, 1.0)
    balance = (seen.mean() / seen) ** removed * (1 + rng.uniform(-0.035, 0.035, 3))
    exposure = rng.uniform(1.05, 1.8) / seen.mean()
    return ColorCamera(
        _color(balance * exposure),
        drift=float(rng.uniform(0.03, 0.1)),
        period_frames=float(rng.uniform(60, 160)),
        phase=float(rng.uniform(0, 2 * np.pi)),
        vignetting=float(rng.uniform(0.05, 0.4)),
        saturation=float(rng.uniform(0.65, 1.15)),
        blur_px=float(rng.uniform(0.5, 0.95)),
        noise=float(rng.uniform(1.0, 3.5)),
        color_noise=float(rng.uniform(0.3, 2.0)),
    )


def _ceiling(rng: np.random.Generator, points: int, color: Color, strength: float) -> Lamp:
    middle = np.array([*rng.uniform(-1.4, 1.4, 2), rng.uniform(2.2, 2.6)])
    spread = rng.uniform(0.1, 0.3)
    turns = 2 * np.pi * np.arange(points) / points
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(points)])
    return Lamp(middle + spread * ring * (points > 1), color, strength)


def _window(rng: np.random.Generator, half_m: float, color: Color, strength: float) -> Lamp:
    bearing = int(rng.integers(4)) * np.pi / 2
    out, aside = np.array([np.cos(bearing), np.sin(bearing), 0]), np.array([-np.sin(bearing), np.cos(bearing), 0])
    middle = (half_m - 0.45) * out + rng.uniform(-1.2, 1.2) * aside + np.array([0, 0, rng.uniform(1.5, 1.9)])
    across = np.array([-1.0, 1.0, 0.0])[:, None] * aside * rng.uniform(0.2, 0.5)
    points = middle + across + np.array([[0, 0, 0.0], [0, 0, 0], [0, 0, 0.45]])
    return Lamp(points, color, strength, 1.6)


def _color(values: Float64Array) -> Color:
    return float(values[0]), float(values[1]), float(values[2])
