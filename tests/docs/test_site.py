"""The documentation as a site: it builds, and no link of it is dead."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
# Of the repository, as the workflow gives it to the build.
ADDRESS = "https://example.org/cuboid/cuboid"


class Links(HTMLParser):
    """The links of a page, and what can be linked to in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.names |= {name for name in (found.get("id"), found.get("name")) if name}
        link = found.get("href") if tag == "a" else found.get("src") if tag == "img" else None
        if link:
            self.links.append(link)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    env = os.environ | {"CUBOID_REPOSITORY": ADDRESS}
    done = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, timeout=300, check=False, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_no_link_within_it_is_dead(site: Path) -> None:
    pages = {file: Links(file.read_text(encoding="utf-8")) for file in site.rglob("*.html") if file.name != "404.html"}
    assert len(pages) > 20
    dead = []
    for file, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file() or (
                parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].names
            ):
                dead.append(f"{file.relative_to(site)}: {link}")
    assert not dead, "\n".join(dead)


def test_the_reference_is_part_of_it(site: Path) -> None:
    for name, words in (("commands", "--pose-offset"), ("files", "size_sigma_m"), ("http", "/api/last-seen")):
        assert words in (site / "reference" / name / "index.html").read_text(encoding="utf-8")
    assert (site / "reference" / "schemas" / "objects.schema.json").is_file()


def test_a_page_asks_nobody_else(site: Path) -> None:
    text = (site / "index.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="https?://(?!(?:squidfunk|www\.mkdocs))[^"]*\.(?:js|css|woff2?)"', text)


def test_each_page_links_to_the_repository(site: Path) -> None:
    for name in ("index.html", "results/index.html"):
        assert ADDRESS in Links((site / name).read_text(encoding="utf-8")).links


def test_the_python_page_has_signatures_with_types(site: Path) -> None:
    text = re.sub(r"<[^>]+>", "", (site / "python" / "index.html").read_text(encoding="utf-8"))
    for words in ("open_camera", "TrackerConfig", "RecordingLike | FrameSource", "to_pandas"):
        assert words in text.replace("&nbsp;", " "), words
