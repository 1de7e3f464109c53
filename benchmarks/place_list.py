"""The places by which a change of the method is judged: real recordings, two sets of stills, and made ones."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.lab.synthetic import KINDS
from cuboid.lab.synthetic.kinds import FRAMES
from scenes import SOURCE, TRUTH, source_digest
from still_recordings import STILL_SETS, StillSet, still_parts

DRAWN = Path(__file__).resolve().parent / "truth"
# Images of made recordings, and their frames at most: a made place takes about as long as a short real one.
MADE_SIZE, MADE_FRAMES = "480x360", 90
MADE_SENSORS = ("structured-light", "time-of-flight")
# The kind of place of sets of single pictures.
STILLS = "stills"
# The kind of place of each kind of made scene; another kind of scene is a kind of place of its own.
KIND_OF_MADE = {
    **dict.fromkeys(("table", "occluders", "leave", "tables", "clutter", "counter", "stacks", "containers"), "table"),
    **dict.fromkeys(("sideboard", "tray", "alone"), "table"),
    **dict.fromkeys(("room", "kitchen", "floor"), "room"),
    **dict.fromkeys(("bin", "toybox"), "bin"),
    **dict.fromkeys(("shelf", "bookshelf"), "shelf"),
}


@dataclass(frozen=True, slots=True)
class Part:
    """A recording of a place, with its truth.

    Attributes
    ----------
    name : str
        Unique among all parts.
    recording : Path
    truths : tuple of Path
        Truth files and keyframes.
    synth : tuple of str
        Arguments of `cuboid synth` that make the recording; empty if it is real.
    """

    name: str
    recording: Path
    truths: tuple[Path, ...]
    synth: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Place:
    """A place with its recordings.

    Attributes
    ----------
    name, kind : str
    iou : float
        IoU of a pair.
    made : bool
        Whether it is synthetic.
    parts : tuple of Part
    """

    name: str
    kind: str
    iou: float
    made: bool
    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class RealPlace:
    """A real recording.

    Attributes
    ----------
    name : str
        Name of its folder, and beginning of the names of its truth files.
    kind : str
    about : str
        What it shows, for readers of the tables.
    iou : float
        0.25 where the truth is loose.
    recording : str
        Under its folder.
    truths : tuple of str
        Truth beside the recording, under its folder.
    """

    name: str
    kind: str
    about: str
    iou: float = 0.5
    recording: str = ""
    truths: tuple[str, ...] = ()


DATA = (
    RealPlace(
        "rgbd-scenes-v2",
        "table",
        "a coffee table (scene 01)",
        recording="imgs/scene_01",
        truths=("ground_truth/01.json",),
    ),
    RealPlace("rgbd_dataset_freiburg1_xyz", "desk", "a cluttered desk, first half of TUM fr1/xyz"),
    RealPlace("desk-realsense", "desk", "an office desk, RealSense at 5 Hz", truths=("keyframes.json",)),
    RealPlace("office-scan", "room", "a scanned office", truths=("truth.json",)),
    RealPlace("dish-from-above", "overhead", "a dish from straight above"),
    RealPlace("overhead-hands", "moving", "hands above a table, depth 20 px beside color", 0.25),
    RealPlace("bin-robot-hand", "bin", "a bin, seen from a robot's hand", 0.25, truths=("keyframes.json",)),
)
FURTHER = (
    RealPlace("cafe", "table", "the counter of a cafe"),
    RealPlace("redkitchen", "room", "a cluttered kitchen, color and depth not registered"),
    RealPlace("rgbd_dataset_freiburg1_xyz_b", "desk", "the same desk, second half of TUM fr1/xyz"),
    RealPlace("mini_shelf", "shelf", "groceries in a carton on its side"),
    RealPlace("toys_moving", "moving", "toys in a bin; the camera and the toys move", 0.25),
    RealPlace("hands", "moving", "the hands above a table, four times as long", 0.25),
)
_NAMES = [place.name for place in (*DATA, *FURTHER)]


@dataclass(frozen=True, slots=True)
class Folders:
    """The folders of recordings and of their truth.

    Attributes
    ----------
    data, real, real_truth : Path or None
        Recordings with their truth; further recordings; the drawn truth of these.
    work : Path
        Keeps made recordings and results.
    """

    data: Path | None
    real: Path | None
    real_truth: Path | None
    work: Path


def real_places(folders: Folders, every_still: int) -> tuple[list[Place], list[str]]:
    """Return the real places that are there, and the names of those that are not.

    Parameters
    ----------
    folders : Folders
    every_still : int
        Step between two stills that are taken; 1 takes all.
    """
    found, absent = [], []
    for root, places in ((folders.data, DATA), (folders.real, FURTHER)):
        for real in places:
            place = None if root is None else _real_place(real, root / real.name, folders.real_truth)
            found += [place] if place else []
            absent += [] if place else [real.name]
    for stills, root in zip(STILL_SETS, (folders.data, folders.real), strict=True):
        if root is None or not (root / stills.name / stills.table).is_file():
            absent.append(stills.name)
        else:
            found.append(_still_place(stills, root, folders.work, every_still))
    return found, absent


def _real_place(real: RealPlace, folder: Path, further_truth: Path | None) -> Place | None:
    """Return a place, or None if its recording or its truth is absent."""
    truths = [*(folder / name for name in real.truths), *drawn_truth(real.name)]
    truths += [] if further_truth is None else [further_truth / f"{real.name}.keyframes.json"]
    truths = [path for path in truths if path.is_file()]
    if not (truths and (folder / real.recording).is_dir()):
        return None
    part = Part(real.name, folder / real.recording, tuple(truths))
    return Place(real.name, real.kind, real.iou, made=False, parts=(part,))


def drawn_truth(name: str) -> list[Path]:
    """Return the files of drawn truth whose names begin with that of a place, and not with a longer one of another."""
    longer = [other for other in _NAMES if other.startswith(name) and other != name]
    return [path for path in sorted(DRAWN.glob(f"{name}*.json")) if not path.name.startswith(tuple(longer))]


def _still_place(stills: StillSet, root: Path, work: Path, every: int) -> Place:
    parts = [Part(name, folder, (truth,)) for name, folder, truth in still_parts(stills, root, work)]
    return Place(stills.name, STILLS, 0.5, made=False, parts=tuple(parts[::every]))


def made_places(seeds: Sequence[int], work: Path) -> list[Place]:
    """Return a place for each kind of made scene, with a recording for each seed; `render` makes the recordings."""
    if not seeds:
        return []
    styled = "--style" in _synth("--help")
    recordings = work / "recordings" / source_digest("lab/synthetic")
    return [
        Place(
            f"made {kind}",
            KIND_OF_MADE.get(kind, kind),
            0.5,
            made=True,
            parts=tuple(_made(kind, seed, MADE_SENSORS[(seed + k) % 2], recordings, styled) for seed in seeds),
        )
        for k, kind in enumerate(KINDS)
    ]


def _made(kind: str, seed: int, sensor: str, recordings: Path, styled: bool) -> Part:
    frames = min(FRAMES[kind], MADE_FRAMES)
    name = f"{kind}-{seed}-{frames}f-{sensor}-{MADE_SIZE}{'-real' if styled else ''}"
    folder = recordings / name
    call = ["--kind", kind, "--seed", str(seed), "--frames", str(frames), "--size", MADE_SIZE, "--sensor", sensor]
    call += ["--style", "real"] if styled else []
    return Part(f"{recordings.name}-{name}", folder, (folder / TRUTH,), tuple(call))


def render(part: Part) -> str | None:
    """Make the recording of a part, unless it is there; return the reason if that fails."""
    if not part.synth or (part.recording / TRUTH).is_file():
        return None
    part.recording.parent.mkdir(parents=True, exist_ok=True)
    try:
        _synth(*part.synth, "--output", str(part.recording), "--workers", "1", "--force")
    except InputError as error:
        return str(error)
    return None


def _synth(*call: str) -> str:
    """Return what `cuboid synth` of this checkout prints; raise InputError if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "cuboid", "synth", *call],
        capture_output=True,
        text=True,
        check=False,
        env=environment(SOURCE.parent),
    )
    if done.returncode:
        raise InputError(f"cuboid synth {' '.join(call)}: {last_line(done.stderr)}")
    return done.stdout


def environment(source: Path) -> dict[str, str]:
    """Return the environment of a process that imports Cuboid from a folder of sources and has one thread."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    return {**os.environ, **one, "PYTHONPATH": str(source)}


def last_line(text: str) -> str:
    """Return the last line of a program's messages: the error."""
    return next(iter(text.strip().splitlines()[::-1]), "no message")


def named(places: Sequence[Place], only: Sequence[str]) -> Iterator[Place]:
    """Iterate over the places with these names or kinds; all if none is given."""
    return (place for place in places if not only or place.name in only or place.kind in only)
