"""The table of exports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cuboid.core.registry import Registry
from cuboid.outputs import Results


@dataclass(frozen=True, slots=True)
class Export:
    """A form that results can be given.

    Attributes
    ----------
    suffix : str
        What the name of its file ends with; empty where it is a folder of files.
    write : callable
        (run, path) -> lines that the user should read. It writes the file, or files into the folder, at the path.
    names : str
        For a folder: regular expression of the names of its files.
    """

    suffix: str
    write: Callable[[Results, Path], list[str]]
    names: str = ""


EXPORTS: Registry[Export] = Registry("export", "cuboid.exports")
