"""The table of exports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cuboid.ground.core.registry import Registry


@dataclass(frozen=True, slots=True)
class Export:
    """A form that results can be given.

    Attributes
    ----------
    suffix : str
        What the name of its file ends with; empty where it is a folder of files.
    purpose : str
        The programs that it is for, and what it holds.
    write : callable
        (run, path) -> lines that the user should read. It writes the file, or files into the folder, at the path.
    names : str
        For a folder: regular expression of the names of its files.
    extra : str
        The extra that it needs.
    options : tuple of str
        Names of the options that `write` takes besides.
    one_camera : bool
        Whether a file is for one camera: of a rig, each camera gets a file, whose name ends with that of the camera.
    """

    suffix: str
    purpose: str
    write: Callable[..., list[str]]
    names: str = ""
    extra: str = ""
    options: tuple[str, ...] = ()
    one_camera: bool = False


EXPORTS: Registry[Export] = Registry("export", "cuboid.exports")


def markdown() -> str:
    """Return the table of all exports for the documentation."""
    lines = ["| `--to` | PATH | for |", "|---|---|---|"]
    for name, form in EXPORTS.items():
        needs = f"; needs [the extra `{form.extra}`](install.md#extras)" if form.extra else ""
        lines.append(f"| `{name}` | {f'`{form.suffix}`' if form.suffix else 'a folder'} | {form.purpose}{needs} |")
    return "\n".join(lines) + "\n"
