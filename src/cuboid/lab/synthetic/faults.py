"""Deliberate faults in a recording, as they occur in practice."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cuboid.ground.core.errors import InputError

Image = npt.NDArray[Any]

FAULTS_FILE = "faults.json"


def _color(folder: Path, frame: int) -> Path:
    return folder / "color" / f"{frame:06d}.jpg"


def _depth(folder: Path, frame: int) -> Path:
    return folder / "depth" / f"{frame:06d}.png"


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)


def _halve(folder: Path, frame: int) -> None:
    for path in (_color(folder, frame), _depth(folder, frame)):
        _rewrite(path, lambda image: image[::2, ::2])


def _rewrite(path: Path, change: Callable[[Image], Image]) -> None:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, "the recording was whole before"
    done, data = cv2.imencode(path.suffix, np.ascontiguousarray(change(image)))
    assert done
    path.write_bytes(data.tobytes())


def _edit_pose(folder: Path, frame: int, change: Callable[[list[str]], list[str] | None]) -> None:
    path = folder / "poses.txt"
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.split()
        changed = change(words) if words[0] == str(frame) else words
        if changed is not None:
            lines.append(" ".join(changed))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _drop_last_poses(folder: Path, frame: int) -> None:
    """Remove the poses of `frame` and all later frames."""
    path = folder / "poses.txt"
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[: frame + 1]) + "\n", encoding="utf-8")


def _scale_depth(folder: Path, frame: int) -> None:
    path = folder / "camera.json"
    camera = json.loads(path.read_text(encoding="utf-8"))
    camera["depth_units_per_metre"] = 1
    path.write_text(json.dumps(camera) + "\n", encoding="utf-8")


Fault = Callable[[Path, int], object]

# Faults of a single frame.
FRAME_FAULTS: Mapping[str, Fault] = {
    "truncated-color": lambda folder, k: _cut(_color(folder, k)),
    "truncated-depth": lambda folder, k: _cut(_depth(folder, k)),
    "empty-color": lambda folder, k: _color(folder, k).write_bytes(b""),
    "empty-depth": lambda folder, k: _depth(folder, k).write_bytes(b""),
    "damaged-depth": lambda folder, k: _flip(_depth(folder, k)),
    "no-image": lambda folder, k: _color(folder, k).write_bytes(b"no image\n" * 40),
    "color-only": lambda folder, k: _depth(folder, k).unlink(),
    "depth-only": lambda folder, k: _color(folder, k).unlink(),
    "other-size": _halve,
    "zero-depth": lambda folder, k: _rewrite(_depth(folder, k), np.zeros_like),
    "nan-pose": lambda folder, k: _edit_pose(folder, k, lambda w: [w[0], "nan", *w[2:]]),
    "inf-pose": lambda folder, k: _edit_pose(folder, k, lambda w: [w[0], "inf", *w[2:]]),
    "non-rigid-pose": lambda folder, k: _edit_pose(folder, k, lambda w: [*w[:7], "2.5"]),
    "no-pose": lambda folder, k: _edit_pose(folder, k, lambda w: None),
}
# Faults of the end of the recording, or of all of it.
WHOLE_FAULTS: Mapping[str, Fault] = {
    "few-poses": _drop_last_poses,
    "no-intrinsics": lambda folder, k: (folder / "camera.json").unlink(),
    "wrong-depth-scale": _scale_depth,
}
FAULTS: Mapping[str, Fault] = {**FRAME_FAULTS, **WHOLE_FAULTS}
# Fraction of the frames, at the end, whose poses "few-poses" removes.
FEW_POSES_FRACTION = 0.1


def named(words: Sequence[str], frames: int) -> tuple[str, ...]:
    """Return the named faults, for a recording of this many frames; `all` stands for all single-frame faults.

    Raises
    ------
    InputError
        A word is not the name of a fault, or there are fewer frames than single-frame faults.
    """
    names: list[str] = []
    for word in words:
        if word != "all" and word not in FAULTS:
            raise InputError(f"no fault is called '{word}'; there are all, {', '.join(FAULTS)}")
        names += [name for name in (FRAME_FAULTS if word == "all" else (word,)) if name not in names]
    single, whole = sum(name in FRAME_FAULTS for name in names), _first_without_pose(names, frames)
    if single > whole:
        raise InputError(f"{single} faults need as many frames, the recording has {whole}")
    return tuple(names)


def _first_without_pose(names: Sequence[str], frames: int) -> int:
    """Return the first frame without a pose due to "few-poses", else the number of frames."""
    return frames - max(1, round(FEW_POSES_FRACTION * frames)) if "few-poses" in names else frames


def spoil(folder: Path, faults: Sequence[str], frames: int, rng: np.random.Generator) -> None:
    """Add faults to an intact recording, at most one per frame, and list them in `faults.json`.

    Parameters
    ----------
    folder : Path
        A synthetic recording.
    faults : sequence of str
        Names in `FAULTS`.
    frames : int
        Number of frames of the recording.
    rng : numpy.random.Generator

    Raises
    ------
    InputError
        A fault is unknown, or there are fewer frames than single-frame faults.
    """
    names = named(faults, frames)
    single = [name for name in names if name in FRAME_FAULTS]
    last = _first_without_pose(names, frames)
    places = dict(zip(single, sorted(rng.choice(last, len(single), replace=False).tolist()), strict=True))
    notes = []
    for name in names:
        place = places.get(name, last)
        FAULTS[name](folder, place)
        notes.append({"fault": name, "frame": place if name in places or name == "few-poses" else None})
    (folder / FAULTS_FILE).write_text(json.dumps({"faults": notes}, indent=1) + "\n", encoding="utf-8")
