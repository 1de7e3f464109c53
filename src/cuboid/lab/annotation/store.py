"""The keyframes file during annotation: always complete, and never overwriting another program's changes."""

from __future__ import annotations

import threading
from decimal import Decimal
from typing import Any

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.json_validation import read_any
from cuboid.ground.formats.keyframes_file import FORMAT, VERSION
from cuboid.ground.formats.reading import MAX_JSON_BYTES, read_bytes
from cuboid.inputs.readers.recording import Recording
from cuboid.lab.evaluation.keyframes import check_frames, file_number, keyframes_from_json
from cuboid.results.files.objects import write_json
from cuboid.results.files.pending import replacing


class Outdated(Exception):  # noqa: N818 - an answer to the client, not a fault
    """The keyframes were changed by another program or page in the meantime."""


class KeyframesFile:
    """The keyframes of a recording in a file, which is created with the first change.

    Parameters
    ----------
    path : path
    recording : Recording

    Attributes
    ----------
    revision : int
        Number that increases with each change.
    document : dict
        Contents of the file, including unknown fields.

    Raises
    ------
    InputError
        The file holds something else, or keyframes of another recording.
    """

    def __init__(self, path: PathLike, recording: Recording) -> None:
        self.path = as_path(path)
        self.revision = 0
        self._recording = recording
        self._lock = threading.Lock()
        self._content = self._on_disk()
        if self._content is None:
            head = {"format": FORMAT, "version": VERSION, "name": recording.path.name}
            self.document: dict[str, Any] = {**head, "objects": [], "frames": []}
        else:
            self.document = read_any(self.path)
            self._check(self.document)

    def save(self, revision: int, document: dict[str, Any]) -> int:
        """Replace the keyframes atomically; return the new revision.

        Parameters
        ----------
        revision : int
            Revision on which the change is based.
        document : dict
            The new keyframes.

        Raises
        ------
        Outdated
            The keyframes were changed meanwhile, by another page or in the file.
        InputError
            The document contains no keyframes, or not those of this recording.
        OutputError
            The file cannot be written; it is unchanged.
        """
        with self._lock:
            self._check(document)
            if revision != self.revision:
                raise Outdated("the keyframes were changed on another page since; load this one again")
            if self._on_disk() != self._content:
                raise Outdated(f"{self.path.name} was changed by another program since; run 'cuboid annotate' again")
            self._write(document)
            self.document = document
            self.revision += 1
            return self.revision

    def _on_disk(self) -> bytes | None:
        return read_bytes(self.path, MAX_JSON_BYTES) if self.path.exists() else None

    def _write(self, document: dict[str, Any]) -> None:
        with replacing(self.path) as partial:
            write_json(partial, self._tidy(document))
            content = partial.read_bytes()
        self._content = content

    def _tidy(self, document: dict[str, Any]) -> dict[str, Any]:
        """Return the document with its frames in order, each with the number in its file name."""
        frames = sorted(document["frames"], key=lambda item: int(item["frame"]))
        for item in frames:
            number = file_number(self._recording, item["frame"])
            if number is not None:
                item["number"] = _plain(number)
        return {**document, "frames": frames}

    def _check(self, document: dict[str, Any]) -> None:
        keyframes = keyframes_from_json(self.path, document)
        check_frames(keyframes, self._recording)
        width, height = self._recording.intrinsics.width, self._recording.intrinsics.height
        for item in keyframes.frames:
            for x0, y0, x1, y1 in (*item.rects_xyxy.tolist(), *item.ignored.tolist()):
                if min(x0, y0) < 0 or x1 > width or y1 > height:
                    raise InputError(
                        f"{self.path}: frame {item.frame}: expected rectangles within {width} x {height} pixels, "
                        f"got [{x0:g}, {y0:g}, {x1:g}, {y1:g}]"
                    )


def _plain(number: Decimal) -> int | float:
    return int(number) if number == number.to_integral_value() else float(number)
