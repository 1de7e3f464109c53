"""How a camera sees color: exposure, white balance, blur, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from meshes import Floats, Image, Rng
from sensors import Map


@dataclass(frozen=True)
class Look:
    """How a camera sees color throughout a scene.

    Attributes
    ----------
    gain : array, shape (3,)
        White balance of R, G and B.
    brightness : float
        Mean that automatic exposure aims at, of 255.
    blur_px, motion_px : float
        Deviation of the blur, and length of the motion of the camera during the exposure.
    gamma, noise, vignette : float
        Exponent of the contrast, deviation at full light of 255, darkening of the corners.
    """

    gain: Floats
    brightness: float
    blur_px: float
    motion_px: float
    gamma: float
    noise: float
    vignette: float

    @classmethod
    def draw(cls, rng: Rng) -> Look:
        """Draw a camera: mostly a good one, at times dark, bright, blurred, noisy or with a color cast."""
        cast = rng.normal(0, 0.06 if rng.random() < 0.8 else 0.14, 3)
        return cls(
            gain=1 + cast - cast.mean(),
            brightness=rng.uniform(85, 145) if rng.random() < 0.9 else rng.uniform(35, 190),
            blur_px=rng.uniform(0.4, 0.9) if rng.random() < 0.85 else rng.uniform(0.9, 1.7),
            motion_px=rng.uniform(2, 7) if rng.random() < 0.2 else 0.0,
            gamma=rng.uniform(0.75, 1.25),
            noise=rng.uniform(0.8, 3.5) if rng.random() < 0.85 else rng.uniform(3.5, 9),
            vignette=rng.uniform(0, 0.4),
        )

    def picture(self, color: Map, rng: Rng) -> Image:
        """Return the 8-bit RGB picture of clean color."""
        h, w = color.shape[:2]
        light = 255 * (np.clip(color, 0, 255) / 255) ** self.gamma
        light *= np.clip(self.brightness / max(light.mean(), 1), 0.5, 3.5)
        blurred = cv2.GaussianBlur(light.astype(np.float32), (0, 0), self.blur_px)
        if self.motion_px:
            blurred = cv2.filter2D(blurred, -1, _motion_kernel(self.motion_px, rng.uniform(0, np.pi)))
        v, u = np.mgrid[:h, :w].astype(np.float32)
        radius = ((u / w - 0.5) ** 2 + (v / h - 0.5) ** 2)[..., None]
        out = blurred * self.gain * rng.uniform(0.93, 1.07) * (1 - self.vignette * radius)
        sigma = self.noise * np.sqrt(0.5 + out.clip(0, 255) / 200)
        noisy = out + rng.standard_normal(out.shape, np.float32) * sigma + 0.5
        return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def _motion_kernel(length_px: float, angle_rad: float) -> Map:
    """Return the kernel of a straight motion."""
    middle = int(length_px / 2) + 1
    kernel = np.zeros((2 * middle + 1,) * 2, np.float32)
    x, y = (round(middle * float(f(angle_rad))) for f in (np.cos, np.sin))
    cv2.line(kernel, (middle - x, middle - y), (middle + x, middle + y), 1.0)
    return np.asarray(kernel / kernel.sum(), np.float32)
