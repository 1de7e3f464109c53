"""Random changes to files: of their bytes, their lines and words, their JSON, their images, of what they are."""

from __future__ import annotations

import json
import random
import re
import zlib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from changes import SPECIAL, Change

LONG = "x" * 20_000
WORDS = (
    "nan", "inf", "-inf", "1e999", "-1", "0", "-0", "1", "0.5", "1e308", "-1e308", "1e-320", "2147483648", "4294967296",
    "9223372036854775808", "1" + "0" * 30, "9" * 5000, "", "x", "null", "true", "[]", "{}", "''", '"', "0x10", "1_0",
    "٣", "１", "\x00", "\x1b[31mred", "a\nb", "\u2028", "\u202egnp", "🙂", "../../etc/passwd", "/dev/zero", "%s%n",
    "</script><img src=x onerror=alert(1)>", LONG, "1,2", "1;2", " ", "#",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 0.5, -0.5, 1e308, -1e308, 1e-320, 2**31, 2**32, 2**63, 2**64, 10**30, 10**400, "",
    "x", LONG, "\x00", "\x1b[2J", "</script><img src=x onerror=alert(1)>", [], {}, [0], [None], {"a": 1}, [[[[]]]],
    [1e308] * 3, [0, 0, 0], [[0, 0, 0]] * 3, [[2, 0, 0], [0, 2, 0], [0, 0, 2]], [1] * 1000, "given", 10**9, 10**7,
)  # fmt: skip


def mutated(rng: random.Random, path: str, content: bytes) -> Change:
    """Return a change of a file."""
    if rng.random() < 0.06:
        return Change(path, special=rng.choice(SPECIAL))
    return Change(path, rng.choice(_kinds_for(path))(rng, content))


def _kinds_for(path: str) -> tuple[Callable[[random.Random, bytes], bytes], ...]:
    suffix = path.rpartition(".")[2]
    if suffix in ("png", "jpg"):
        return of_bytes, of_bytes, of_image, of_header
    if suffix == "json":
        return of_bytes, of_words, of_json, of_json, of_json, of_json
    if suffix in ("csv", "txt", "pose", "label", "obj"):
        return of_bytes, of_words, of_words, of_lines
    if suffix == "ply":
        return of_bytes, of_bytes, of_ply
    return (of_bytes,)


def of_bytes(rng: random.Random, content: bytes) -> bytes:
    """Change bytes, wherever they are."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 5, 30))):
        at, size = rng.randrange(len(data) + 1), rng.choice((1, 1, 4, 16, 200))
        match rng.randrange(8):
            case 0:
                del data[at:]
            case 1:
                del data[at : at + size]
            case 2:
                data[at:at] = rng.randbytes(size)
            case 3 | 4:
                if at < len(data):
                    data[at] ^= 1 << rng.randrange(8)
            case 5:
                data[at : at + size] = bytes([rng.choice((0, 255, 10, 34))]) * size
            case 6:
                data[at:at] = data[max(0, at - size) : at]
            case 7:
                data[at : at + size] = rng.randbytes(size)
    return bytes(data)


def of_words(rng: random.Random, content: bytes) -> bytes:
    """Put other words into the place of numbers and names."""
    text = content.decode("utf-8", "replace")
    words = list(re.finditer(r"[\w.+-]+", text))
    if not words:
        return rng.choice(WORDS).encode("utf-8", "replace")
    for chosen in sorted(rng.sample(words, min(len(words), rng.choice((1, 1, 1, 3)))), key=lambda m: -m.start()):
        text = text[: chosen.start()] + rng.choice(WORDS) + text[chosen.end() :]
    return text.encode("utf-8", "replace")


def of_lines(rng: random.Random, content: bytes) -> bytes:
    """Remove, repeat, swap and break lines; write the text otherwise."""
    lines = content.decode("utf-8", "replace").split("\n")
    k = rng.randrange(len(lines))
    match rng.randrange(10):
        case 0:
            del lines[k]
        case 1:
            lines.insert(k, lines[rng.randrange(len(lines))])
        case 2:
            lines[k] = lines[k].replace(",", " ").replace(" ", rng.choice((",", "\t", ";", "  ")))
        case 3:
            rng.shuffle(lines)
        case 4:
            return "\r\n".join(lines).encode("utf-8")
        case 5:
            return "\n".join(lines).encode(rng.choice(("utf-16", "utf-32", "utf-8-sig", "utf-7")))
        case 6:
            lines = lines[:k]
        case 7:
            lines[k] = rng.choice(WORDS)
        case 8:
            lines[k] = lines[k] * rng.choice((2, 500))
        case 9:
            return b""
    return "\n".join(lines).encode("utf-8", "replace")


def of_json(rng: random.Random, content: bytes) -> bytes:
    """Change a value of a JSON document, whatever depth it is at."""
    document = json.loads(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        document = _changed_value(rng, document)
    text = json.dumps(document)
    if rng.random() < 0.03:
        text = text.replace("0", rng.choice(("NaN", "Infinity", "1e999", "00")), 1)
    if rng.random() < 0.03:
        depth = rng.choice((100, 5_000, 200_000))
        text = text[:-1] + f', "deep": {"[" * depth}{"]" * depth}}}'
    return text.encode("utf-8", "replace")


def _changed_value(rng: random.Random, value: Any) -> Any:
    """Return a document with one value changed."""
    if not isinstance(value, dict | list) or not value or rng.random() < 0.08:
        return rng.choice(VALUES)
    if isinstance(value, list):
        k = rng.randrange(len(value))
        match rng.randrange(6):
            case 0:
                return value[:k] + value[k + 1 :]
            case 1:
                return [*value, value[k]]
            case _:
                return [*value[:k], _changed_value(rng, value[k]), *value[k + 1 :]]
    name = rng.choice(sorted(value))
    match rng.randrange(8):
        case 0:
            return {key: item for key, item in value.items() if key != name}
        case 1:
            return {**value, rng.choice((*WORDS, name.upper())): value[name]}
        case _:
            return {**value, name: _changed_value(rng, value[name])}


def of_image(rng: random.Random, content: bytes) -> bytes:
    """Make another image: of other size, depth, channels, content, format."""
    height, width = rng.choice(((48, 64), (48, 64), (1, 1), (1, 3000), (3000, 1), (47, 64), (2000, 2000)))
    kind = rng.choice((np.uint8, np.uint16))
    channels = rng.choice((1, 1, 3, 4))
    fill = rng.choice((0, 1, 255, 1000, 65535))
    image = np.full((height, width, channels), min(fill, np.iinfo(kind).max), kind)
    if rng.random() < 0.3:
        image = np.random.default_rng(rng.randrange(1000)).integers(0, np.iinfo(kind).max, image.shape).astype(kind)
    suffix = rng.choice((".png", ".png", ".png", ".jpg", ".bmp", ".tiff", ".webp", ".pgm"))
    try:
        done, data = cv2.imencode(suffix, image)
    except cv2.error:
        done = False
    return data.tobytes() if done else content[: len(content) // 2]


def of_header(rng: random.Random, content: bytes) -> bytes:
    """Let the header of a PNG, its checksum right, say something else; change bytes at the beginning of others."""
    side = lambda: rng.choice((0, 1, 64, 8192, 8193, 30_000, 65_535, 2**31 - 1, 2**32 - 1))  # noqa: E731
    if not content.startswith(b"\x89PNG"):
        data = bytearray(content)
        data[rng.randrange(2, min(700, len(data)))] = rng.randrange(256)
        return bytes(data)
    header = bytearray(content[12:29])
    header[4:8] = side().to_bytes(4, "big")
    if rng.random() < 0.7:
        header[8:12] = side().to_bytes(4, "big")
    if rng.random() < 0.3:
        header[12:17] = bytes(rng.choice((0, 1, 2, 3, 4, 6, 8, 16)) for _ in range(5))
    return content[:12] + bytes(header) + zlib.crc32(header).to_bytes(4, "big") + content[33:]


def of_ply(rng: random.Random, content: bytes) -> bytes:
    """Change the words of a PLY's header, or the numbers of its points."""
    head, mark, body = content.partition(b"end_header\n")
    if rng.random() < 0.6:
        return of_words(rng, head) + mark + body
    values = np.frombuffer(body[: len(body) // 4 * 4], "<f4").copy()
    if len(values):
        for _ in range(rng.choice((1, 5))):
            values[rng.randrange(len(values))] = rng.choice((np.nan, np.inf, -np.inf, 1e38, -1e38, 1e-40, 0.0))
    return head + mark + values.tobytes() + body[len(body) // 4 * 4 :]
