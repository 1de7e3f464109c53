"""The page in one file: HTML, style and scripts together with their data."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

from cuboid.ground.core.paths import PathLike, as_path
from cuboid.results.files.naming import page_json
from cuboid.results.files.pending import write_whole
from cuboid.results.views.report.summary import Summary

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
    document = {**summary.to_dict(), "live": live}
    return assembled(
        page_source("page.html"), style(page_source("page.css")), [page_source(name) for name in SCRIPTS], document
    )


def page_source(name: str) -> str:
    """Return the text of a file of the page: HTML, style or script."""
    return (files("cuboid.results.views.report") / "page" / name).read_text(encoding="utf-8")


def style(*parts: str) -> str:
    """Return the style of a page: first the palette and elements that all pages share, then its own parts."""
    return "\n".join((page_source("base.css"), *parts))


def assembled(
    html: str, css: str, scripts: Sequence[str], document: Mapping[str, Any], content: Mapping[str, str] | None = None
) -> str:
    """Return a page assembled from its parts.

    Parameters
    ----------
    html : str
        With placeholders in double braces for the head of all pages, mark, view (the scene in 3D with its toolbar),
        data and script.
    css : str
        From `style`.
    scripts : sequence of str
        In the order of their dependencies; they share one scope, apart from the global one.
    document : mapping
        The data of the scripts, ready for JSON; its "title" is the title of the page.
    content : mapping of str to str, optional
        HTML of further placeholders.
    """
    together = "\n".join(scripts)
    parts = {
        "title": escape(f"{document['title']} - cuboid"),
        "style": css,
        "mark": page_source("mark.svg"),
        "view": page_source("view.html"),
        "data": page_json(document),
        "script": f'"use strict";\n(() => {{\n{together}\n}})();',
        **(content or {}),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], html.replace("{{head}}\n", page_source("head.html")))


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
