"""What is done to a folder of good files to make it a bad one; it can be undone, and kept as a regression case."""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

SPECIAL = ("missing", "folder", "fifo", "socket", "circle", "dangling", "device", "endless", "huge", "unreadable name")

HUGE_BYTES = 3 << 30


@dataclass(frozen=True)
class Change:
    """A file of a folder, and what lies in its place.

    Attributes
    ----------
    path : str
        As seen from the folder.
    content : bytes or None
        What is in it; None: the file is special.
    special : str
        One of `SPECIAL`, or empty.
    """

    path: str
    content: bytes | None = None
    special: str = ""

    def make(self, folder: Path) -> None:
        path = folder / self.path
        remove(path)
        if self.content is not None:
            path.write_bytes(self.content)
        else:
            make_special(path, self.special)

    def to_dict(self) -> dict[str, str]:
        if self.content is None:
            return {"path": self.path, "special": self.special}
        return {"path": self.path, "base64": base64.b64encode(self.content).decode("ascii")}

    @classmethod
    def from_dict(cls, document: dict[str, str]) -> Change:
        content = document.get("base64")
        return cls(
            document["path"], None if content is None else base64.b64decode(content), document.get("special", "")
        )


def make_special(path: Path, kind: str) -> None:
    """Put something at a path that is no regular file of a usual size."""
    match kind:
        case "folder":
            path.mkdir()
        case "fifo":
            os.mkfifo(path)
        case "socket":
            # the name of a socket may have 107 bytes: it is made under a short one, and moved
            with socket.socket(socket.AF_UNIX) as made:
                short = Path("/tmp") / f"fuzz-{os.getpid()}"
                made.bind(str(short))
                shutil.move(short, path)
        case "circle":
            path.symlink_to(path.name)
        case "dangling":
            path.symlink_to("nowhere")
        case "device":
            path.symlink_to("/dev/null")
        case "endless":
            path.symlink_to("/dev/zero")
        case "huge":
            path.touch()
            os.truncate(path, HUGE_BYTES)  # takes no room on disk
        case "unreadable name":
            (path.parent / "\x1b[31mred\n\udcff").write_bytes(b"")


def remove(path: Path) -> None:
    """Remove what lies at a path, if anything does."""
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
    else:
        shutil.rmtree(path)


@contextmanager
def changed(folder: Path, changes: Sequence[Change]) -> Iterator[None]:
    """Make changes to a folder; everything is as before afterwards."""
    before = {change.path: _content(folder / change.path) for change in changes}
    names = set(folder.rglob("*"))
    try:
        for change in changes:
            change.make(folder)
        yield
    finally:
        for path, content in before.items():
            remove(folder / path)
            if content is not None:
                (folder / path).write_bytes(content)
        for item in sorted(set(folder.rglob("*")) - names, reverse=True):
            remove(item)


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def keep(path: Path, target: str, changes: Sequence[Change], fault: str) -> None:
    """Write a case for the tests."""
    document = {"target": target, "fault": fault, "changes": [change.to_dict() for change in changes]}
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def kept(path: Path) -> tuple[str, list[Change]]:
    """Read a case: its target, and the changes."""
    document = json.loads(path.read_text(encoding="utf-8"))
    return document["target"], [Change.from_dict(item) for item in document["changes"]]
