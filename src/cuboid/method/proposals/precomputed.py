"""Proposals that another program made beforehand: one file for each frame, matched by frame number.

    FOLDER/
      00000.csv  or  frame-000000.npz  or  00000-color.mat  ...

The last number in a file name (without its suffix) is the number of its frame, counted from 0 over all frames of the
recording. Coordinates are pixels of the images that are tracked. `cuboid.method.proposals.files` describes the layouts.
"""

from __future__ import annotations

import re
from pathlib import Path

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals.files import LOADERS
from cuboid.method.proposals.registry import SOURCES
from cuboid.method.proposals.types import Proposals, ProposalSource


class Precomputed:
    """Reads the proposals of each frame from a file.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    InputError
        If the folder does not exist, has no file of a known layout, or two files have the same number.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise InputError(f"no folder of proposals at {folder}")
        self._folder = folder
        self._files: dict[int, Path] = {}
        for path in sorted(folder.iterdir()):
            numbers = re.findall(r"\d+", path.stem)
            if path.suffix.lower() not in LOADERS or not numbers:
                continue
            earlier = self._files.setdefault(int(numbers[-1]), path)
            if earlier is not path:
                raise InputError(f"{folder}: {earlier.name} and {path.name} are both of frame {int(numbers[-1])}")
        if not self._files:
            expected = ", ".join(f"NUMBER{suffix}" for suffix in LOADERS)
            raise InputError(f"{folder} has no files of proposals; expected are {expected}")

    def __call__(self, frame: Frame, intrinsics: Intrinsics) -> Proposals:
        """Return the proposals of `frame`, the best first.

        Raises
        ------
        FrameError
            If there is no file for this frame.
        InputError
            If its file cannot be read, or was made for images of another size.
        """
        path = self._files.get(frame.index)
        if path is None:
            raise FrameError(f"frame {frame.index} has no file of proposals in {self._folder}")
        return LOADERS[path.suffix.lower()](path, intrinsics.width, intrinsics.height)


@SOURCES.register("precomputed")
def precomputed_source(options: str | None, config: TrackerConfig) -> ProposalSource:
    """Return the proposals in the folder that `options` names.

    Raises
    ------
    InputError
        If no folder is named, or it cannot be used.
    """
    if not options:
        raise InputError("proposal source 'precomputed' needs the folder of its files: precomputed:FOLDER")
    return Precomputed(Path(options))
