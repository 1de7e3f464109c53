"""Colors and images for surfaces: packages, displays, keys, furniture, scanned textures."""

from __future__ import annotations

import cv2
import numpy as np
from assets import load_texture, texture_files
from meshes import SHINY, Color, Image, Part, Rng, Vector, box, pick


def random_color(rng: Rng) -> Color:
    """Return a color as packages and utensils have it: white, grey, black, brown, pale or saturated."""
    kind = rng.choice(6, p=[0.16, 0.1, 0.12, 0.12, 0.15, 0.35])
    if kind < 3:
        grey = (rng.uniform(0.85, 1), rng.uniform(0.3, 0.75), rng.uniform(0.03, 0.14))[kind]
        return tuple(float(x) for x in np.clip(grey + rng.normal(0, 0.015, 3), 0.02, 1))  # type: ignore[return-value]
    ranges = {
        3: ((10, 20), (70, 150), (70, 210)),
        4: ((0, 179), (25, 90), (170, 250)),
        5: ((0, 179), (140, 250), (80, 250)),
    }[int(kind)]
    pixel = np.array([[[rng.uniform(*x) for x in ranges]]]).astype(np.uint8)
    return tuple(float(x) for x in cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0] / 255)  # type: ignore[return-value]


def _ink(rng: Rng) -> tuple[int, int, int]:
    r, g, b = (int(255 * x) for x in random_color(rng))
    return r, g, b


def _write(image: Image, rng: Rng, x: int, y: int, height: int, width: int, ink: tuple[int, int, int]) -> None:
    """Write a random word of about a height at (x, y), pixels, not wider than a width."""
    scale, letters = height / 22, "".join(rng.choice(list("AEIORSTNLMCDKBPGabeiorstnlm 0258"), rng.integers(3, 12)))
    letters = letters[: max(1, int(width / (18 * scale)))]
    cv2.putText(
        image, letters, (x, y + height), int(rng.choice([0, 2, 3, 4])), scale, ink, max(1, int(height / 8)), cv2.LINE_AA
    )


def printed(rng: Rng, base: Color, height: int = 256, width: int = 384) -> Image:
    """Return the print of a package: patches, stripes, a gradient, emblems, words and small text on a base color."""
    image = np.empty((height, width, 3), np.uint8)
    image[:] = [int(255 * x) for x in base]
    if rng.random() < 0.35:
        ramp = np.linspace(0, 1, height)[:, None, None] ** rng.uniform(0.5, 2)
        image[:] = (image * (1 - ramp) + np.array(_ink(rng)) * ramp).astype(np.uint8)
    if rng.random() < 0.3:
        _photograph(image, rng)
    for _ in range(int(rng.integers(1, 7))):
        ink, (x, y), (w, h) = _ink(rng), rng.integers(-20, [width, height]), rng.integers(16, [width // 2, height // 2])
        kind = rng.integers(5)
        if kind == 0:
            cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), ink, -1)
        elif kind == 1:
            cv2.ellipse(
                image,
                (int(x), int(y)),
                (int(w // 2), int(h // 2)),
                float(rng.uniform(0, 180)),
                0,
                360,
                ink,
                -1,
                cv2.LINE_AA,
            )
        elif kind == 2:
            cv2.rectangle(image, (0, int(y)), (width, int(y + h // 2)), ink, -1)
        elif kind == 3:
            corners = rng.integers(0, [w, h], (int(rng.integers(3, 7)), 2)) + np.array([x, y])
            cv2.fillPoly(image, [cv2.convexHull(corners.astype(np.int32))], ink, cv2.LINE_AA)
        else:
            for k in range(int(rng.integers(3, 9))):
                cv2.line(
                    image,
                    (int(x + k * w // 6), 0),
                    (int(x + k * w // 6 + rng.integers(-3, 4)), height),
                    ink,
                    int(rng.integers(1, 8)),
                )
    for _ in range(int(rng.integers(1, 5))):
        letter = int(rng.integers(14, 60))
        _write(
            image, rng, int(rng.integers(0, width - 40)), int(rng.integers(0, height - 20)), letter, width, _ink(rng)
        )
    for _ in range(int(rng.integers(0, 4))):
        text(image, rng, int(rng.integers(0, int(width * 0.7))), int(rng.integers(0, int(height * 0.8))), 90, 60)
    return image


def _photograph(image: Image, rng: Rng) -> None:
    """Fill a rectangle, or all of an image, with a soft field of colors, as a printed photograph has it."""
    height, width = image.shape[:2]
    x, y = (int(rng.integers(0, n // 2)) if rng.random() < 0.7 else 0 for n in (width, height))
    w, h = (int(n - k - rng.integers(0, n // 4)) for n, k in ((width, x), (height, y)))
    field = rng.random((int(rng.integers(3, 12)), int(rng.integers(3, 12)), 3)) * rng.uniform(0.5, 1, 3)
    fine = cv2.GaussianBlur(rng.standard_normal((h, w, 1)).astype(np.float32), (0, 0), float(rng.uniform(1, 4)))
    wide = cv2.resize(field, (w, h), interpolation=cv2.INTER_CUBIC) + 0.3 * fine.reshape(h, w, 1)
    image[y : y + h, x : x + w] = np.asarray(wide.clip(0, 1) * 255, np.uint8)


def text(
    image: Image, rng: Rng, x: int, y: int, width: int, height: int, ink: tuple[int, int, int] = (40, 40, 40)
) -> None:
    """Draw lines of small text-like dashes into a rectangle of an image, pixels."""
    for row in range(y, y + height, 6):
        at = x
        while at < x + width * rng.uniform(0.6, 1):
            word = int(rng.integers(4, 20))
            cv2.line(image, (at, row), (at + word, row), ink, 2)
            at += word + 4


def surface_print(rng: Rng, base: Color) -> Image:
    """Return a seamless-looking surface of 512 px: plain, speckled, striped, checked, wood-like, woven or blotchy."""
    size = 512
    v, u = np.mgrid[:size, :size].astype(np.float32) / size
    blotch = cv2.GaussianBlur(rng.standard_normal((size, size)).astype(np.float32), (0, 0), float(rng.uniform(1, 12)))
    blotch = blotch / blotch.std()
    kind, strength, waves = rng.integers(7), rng.uniform(0.03, 0.25), int(rng.integers(3, 20))
    pattern = {
        0: 0.02 * blotch,
        1: strength * (rng.random((size, size)) < 0.1),
        2: strength * np.sign(np.sin(2 * np.pi * waves * u)),
        3: strength * np.sign(np.sin(2 * np.pi * waves * u) * np.sin(2 * np.pi * waves * v)),
        4: strength * np.sin(2 * np.pi * (waves * v + 0.6 * np.sin(2 * np.pi * u) + 0.15 * blotch)),
        5: strength * (((u * waves) % 1 < 0.06) | ((v * waves) % 1 < 0.06)) * -1.5,
        6: strength * blotch,
    }[int(kind)]
    other = np.array(random_color(rng)) - base if rng.random() < 0.3 else np.ones(3)
    image = np.asarray(base) + pattern[..., None] * other
    return np.asarray(np.clip(image, 0.02, 1) * 255, np.uint8)


def screen_print(rng: Rng) -> Image:
    """Return the picture on a display: dark, a photograph-like field of colors, or windows with text."""
    image = np.full((288, 512, 3), _ink(rng) if rng.random() < 0.7 else (8, 8, 10), np.uint8)
    kind = rng.random()
    if kind < 0.25:
        return np.full_like(image, int(rng.integers(4, 22)))
    if kind < 0.6:
        field = rng.random((6, 9, 3)) ** rng.uniform(0.6, 2)
        image = (cv2.resize(field, (512, 288), interpolation=cv2.INTER_CUBIC).clip(0, 1) * 255).astype(np.uint8)
    for _ in range(int(rng.integers(0, 5))):
        x, y, w, h = (int(k) for k in rng.integers([0, 0, 80, 60], [380, 200, 400, 240]))
        paper = (int(rng.integers(10, 50)),) * 3 if rng.random() < 0.4 else (int(rng.integers(220, 255)),) * 3
        cv2.rectangle(image, (x, y), (x + w, y + h), paper, -1)
        cv2.rectangle(image, (x, y), (x + w, y + 12), _ink(rng), -1)
        text(image, rng, x + 6, y + 20, w - 20, h - 24, (200, 200, 200) if paper[0] < 99 else (40, 40, 40))
    return image


def key_print(rng: Rng, rows: int, columns: int, base: Color) -> Image:
    """Return rows and columns of keys on a base color, with the same print on every side of the box."""
    image = np.empty((rows * 24, columns * 24, 3), np.uint8)
    image[:] = [int(255 * x) for x in base]
    ink = _ink(rng)
    for y in range(rows):
        for x in range(columns):
            if rng.random() < 0.95:
                cv2.rectangle(image, (x * 24 + 2, y * 24 + 2), (x * 24 + 21, y * 24 + 21), ink, -1)
                cv2.circle(image, (x * 24 + 9, y * 24 + 10), 3, tuple(255 - c for c in ink), -1)
    return image


def _surface_color(rng: Rng, white: float) -> Color:
    """Return a color of furniture or walls: white with a probability, else mostly of wood, grey, black or pale."""
    if rng.random() < white:
        light = rng.uniform(0.8, 1.0)
        r, g, b = light * (1 - 0.06 * rng.random(3))
    else:
        kind = rng.choice(4, p=[0.35, 0.2, 0.2, 0.25])
        if kind == 3:
            return random_color(rng)
        wood = np.array([0.85, 0.62, 0.4]) * rng.uniform(0.25, 1.0) + rng.uniform(-0.05, 0.1)
        grey = rng.uniform(0.06, 0.75) * np.ones(3)
        pale = rng.uniform(0.65, 0.95) * (1 - 0.3 * rng.random(3))
        r, g, b = np.clip((wood, grey, pale)[kind], 0.03, 1)
    return float(r), float(g), float(b)


def surface(rng: Rng, size: Vector, plain: float = 0.35, pale: bool = False) -> Part:
    """Return a box of furniture or building: plain, of a scanned texture, or of a made one."""
    base = _surface_color(rng, 0.7 if pale else 0.3)
    kind = rng.random()
    if kind < plain:
        return box(size, color=base, finish=SHINY if rng.random() < 0.1 else 0)
    texture = load_texture(pick(rng, texture_files())) if kind < 0.75 else surface_print(rng, base)
    tint = tuple(float(x) for x in rng.uniform(0.75, 1.0) * (1 - 0.12 * rng.random(3)))
    return box(size, texture, tint, tile_m=rng.uniform(0.3, 1.6))  # type: ignore[arg-type]


def mean_color(part: Part) -> Color:
    """Return the mean color of a part."""
    mean = np.ones(3) if part.texture is None else part.texture.reshape(-1, 3).mean(0) / 255
    r, g, b = (float(x) for x in mean * part.color)
    return r, g, b
