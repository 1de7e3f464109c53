"""The recordings that the benchmarks use: made ones, kept in a folder between runs, and scene 01 of RGB-D Scenes v2."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import cuboid
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.lab.evaluation.truth import NAME as TRUTH
from cuboid.lab.synthetic import KINDS, make_scene, render_recording

SOURCE = Path(cuboid.__file__).parent
SIZE = (640, 480)


@dataclass(frozen=True, slots=True)
class Case:
    """A recording with its truth.

    Attributes
    ----------
    name, kind : str
    recording, truth : Path
    """

    name: str
    kind: str
    recording: Path
    truth: Path


@dataclass(frozen=True, slots=True)
class MadeScene:
    """What decides a made recording.

    Attributes
    ----------
    kind : str
    seed : int
    frames : int or None
        None: as many as the kind takes.
    sensor, pose_noise : str
    size : (int, int)
        Width and height, pixels.
    """

    kind: str
    seed: int
    frames: int | None = None
    sensor: str = "structured-light"
    pose_noise: str = "none"
    size: tuple[int, int] = SIZE

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"no kind of scene is called '{self.kind}'; there are {', '.join(KINDS)}")

    @property
    def name(self) -> str:
        """A name that no other scene has."""
        parts = [self.kind, str(self.seed)]
        parts += [f"{self.frames}f"] if self.frames else []
        parts += [self.sensor] if self.sensor != "structured-light" else []
        parts += [self.pose_noise] if self.pose_noise != "none" else []
        parts += [f"{self.size[0]}x{self.size[1]}"] if self.size != SIZE else []
        return "-".join(parts)


def source_digest(folder: str = "", source: Path = SOURCE, without: Collection[str] = ()) -> str:
    """Return eight digits that change with a program's source and fitted models, or with those of one of its folders.

    Parameters
    ----------
    folder : str
    source : Path
        Folder of the package.
    without : collection of str
        Packages in it that do not count.
    """
    digest = hashlib.sha256()
    for path in sorted(path for kind in ("py", "json") for path in (source / folder).glob(f"**/*.{kind}")):
        if path.relative_to(source).parts[0] in without:
            continue
        digest.update(str(path.relative_to(source)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def made(scene: MadeScene, work: Path, workers: int = 1) -> Case:
    """Return a made recording, rendering it unless `work` has it; another generator makes it anew."""
    folder = work / "recordings" / source_digest("lab/synthetic") / scene.name
    if not (folder / TRUTH).is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            render_recording(
                make_scene(scene.kind, scene.seed, frames=scene.frames),
                folder,
                sensor=scene.sensor,
                pose_noise=scene.pose_noise,
                size=scene.size,
                workers=workers,
            )
        except OutputError:
            if not (folder / TRUTH).is_file():  # else another process has made it meanwhile
                raise
    return Case(scene.name, scene.kind, folder, folder / TRUTH)


def scene_01(data: Path) -> Case:
    """Return scene 01 of RGB-D Scenes v2 in the folder of real recordings.

    Raises
    ------
    InputError
        If it is not there.
    """
    root = data / "rgbd-scenes-v2"
    recording, truth = root / "imgs" / "scene_01", root / "ground_truth" / "01.json"
    for path in (recording, truth):
        if not path.exists():
            raise InputError(f"{path}: is not there; --data names the folder that holds rgbd-scenes-v2")
    return Case("scene 01", "scene 01", recording, truth)


def cases(kinds: list[str], seeds: list[int], work: Path, data: Path | None, frames: int | None = None) -> list[Case]:
    """Return made recordings of some kinds and seeds and, where `data` is given, scene 01 after them."""
    real = [scene_01(data)] if data is not None else []
    return [made(MadeScene(kind, seed, frames), work) for kind in kinds for seed in seeds] + real
