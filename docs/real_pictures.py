"""Puts pictures of real recordings into the pages, where `docs/make_gallery.py --data DATA` has drawn them.

Real recordings are other people's, and none of their images is part of the repository: the pictures are made where the
recordings are, lie in `docs/gallery/real`, which git leaves alone, and are shown by the site that is built there.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

REAL = Path(__file__).resolve().parent / "gallery" / "real"
# Where they go into the gallery.
PLACE = "<!-- real recordings -->"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the text of a page, with the pictures that are there (called by MkDocs)."""
    if page.file.src_uri == "results.md":
        return markdown.replace(PLACE, "\n\n".join(map(section, drawn())))
    if page.file.src_uri == "finds-nothing.md":
        return re.sub(r"gallery/(look-at-\w+\.jpg)", in_real, markdown)
    return markdown


def drawn() -> list[dict[str, str]]:
    """Return what was drawn: name, title and source of each."""
    index = REAL / "index.json"
    return json.loads(index.read_text(encoding="utf-8")) if index.is_file() else []


def section(sheet: dict[str, str]) -> str:
    """Return the section of a sheet."""
    picture = f"![Labels, heat, own boxes, planes](gallery/real/{sheet['name']}.jpg)"
    return f"### {sheet['title']}\n\n{picture}\n\n{sheet['source']}"


def in_real(match: re.Match[str]) -> str:
    """Return the path of a picture: the one of a real recording, where there is one."""
    return f"gallery/real/{match[1]}" if (REAL / match[1]).is_file() else match[0]
