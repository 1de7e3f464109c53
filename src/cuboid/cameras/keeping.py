"""`--record`: keeps the frames that a live camera gave, as a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from cuboid.core.frame import Frame, Intrinsics
from cuboid.outputs.folder import ResultFolder, writing
from cuboid.readers.depth_camera import DepthCamera
from cuboid.recordings.converting import WRITERS, units_kept

# Forms in which a recording of a live camera may be written.
FORMS = ("plain", "mcap")


@contextmanager
def keeping(
    folder: Path, form: str, intrinsics: Intrinsics, depth_units_per_metre: float, depth_camera: DepthCamera | None
) -> Iterator[Callable[[Frame], None]]:
    """Give a function that writes a frame; the folder appears at the end, however it came about, if it has frames.

    Raises
    ------
    OutputError
        The folder exists, or cannot be written.
    """
    written, finished = 0, False
    units = units_kept(depth_units_per_metre, depth_camera)
    with ResultFolder(folder) as place, writing(folder):
        writer = WRITERS[form](place.file(""), intrinsics, units, None)

        def write(frame: Frame) -> None:
            nonlocal written
            with writing(folder):
                writer.add(frame)
            written += 1

        try:
            with writer:
                try:
                    yield write
                finally:
                    if written:
                        writer.finish()
                        finished = True
        finally:
            if finished:
                place.commit()
