"""The page in one file: HTML, style and scripts together with their data."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from cuboid.ground.core.paths import PathLike, as_path
from cuboid.results.files.naming import page_json
from cuboid.results.files.pending import write_whole
from cuboid.results.views.report.summary import Summary

# The package with the files that pages share.
REPORT = "cuboid.results.views.report"

# Scripts in the order of their dependencies; the live page has the shared ones too.
SHARED = (
    "math.js",
    "elements.js",
    "controls.js",
    "data.js",
    "rows.js",
    "facing.js",
    "shaders.js",
    "renderer.js",
    "scene.js",
    "orbit.js",
    "tags.js",
    "measure.js",
)
SCRIPTS = (
    *SHARED,
    "start.js",
    "timeline.js",
    "naming.js",
    "tree.js",
    "card.js",
    "changes.js",
    "run.js",
    "picture.js",
    "main.js",
    "link.js",
)


def page_of(summary: Summary, live: Mapping[str, Any] | None = None) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    summary : Summary
        The contents of the page.
    live : mapping, optional
        Addresses of the pictures of frames on a server (`cuboid view`); None for a page that is a file.

    Returns
    -------
    str
    """
    return assembled("page.html", ["page.css"], SCRIPTS, {**summary.to_dict(), "live": live})


def assembled(
    html: str,
    styles: Sequence[str],
    scripts: Sequence[str],
    document: Mapping[str, Any],
    content: Mapping[str, str] | None = None,
    *,
    package: str = REPORT,
) -> str:
    """Return a page assembled from files in the folder ``page`` of its package, or else from those of the report.

    Parameters
    ----------
    html : str
        File with placeholders in double braces for the head of all pages, mark, view (the scene in 3D with its
        toolbar), data and script.
    styles : sequence of str
        Files that follow the palette and the elements of all pages.
    scripts : sequence of str
        Files in the order of their dependencies; they share one scope, apart from the global one.
    document : mapping
        The data of the scripts, ready for JSON; its "title" is the title of the page.
    content : mapping of str to str, optional
        HTML of further placeholders.
    package : str
    """

    def joined(names: Iterable[str]) -> str:
        return "\n".join(_source(package, name) for name in names)

    parts = {
        "title": escape(f"{document['title']} - cuboid"),
        "style": joined(["base.css", *styles]),
        "mark": _source(REPORT, "mark.svg"),
        "view": _source(REPORT, "view.html"),
        "data": page_json(document),
        "script": f'"use strict";\n(() => {{\n{joined(scripts)}\n}})();',
        **(content or {}),
    }
    page = _source(package, html).replace("{{head}}\n", _source(REPORT, "head.html"))
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], page)


@cache
def _source(package: str, name: str) -> str:
    """Return the text of a file of a page: that of the package, else that of the report."""
    own = files(package) / "page" / name
    return (own if own.is_file() else files(REPORT) / "page" / name).read_text(encoding="utf-8")


def write_report(path: PathLike, summary: Summary) -> None:
    """Write the page; the file appears, or is replaced, when it is complete.

    Parameters
    ----------
    path : path
        The file.
    summary : Summary
        From `summarise`.

    Raises
    ------
    OutputError
        The file cannot be written; no file is left.
    """
    write_whole(as_path(path), page_of(summary))
