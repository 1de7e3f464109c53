"""The documentation as a site: it builds, no link of it is dead, and the commands that it shows are commands."""

from __future__ import annotations

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from cuboid.cli import COMMANDS, main
from cuboid.cli.optional_words import without_guessing
from fakes import FakeTracker, write_recording

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = [*sorted((REPOSITORY / "docs").rglob("*.md")), REPOSITORY / "README.md"]
# What waits for a browser or a camera, or tracks for minutes, is not run; its words are held against the command.
NOT_RUN = (
    "batch",
    "scene",
    "find",
    "sql",
    "serve",
    "store compact",
    "annotate",
    "view",
    "calibrate",
    "slam",
    "demo",
    "synth",
    "evaluate",
    "evaluate trajectory",
    "bench",
    "doctor",
    "compile",
)


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
    done = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, timeout=300, check=False)
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


def test_a_page_asks_nobody_else(site: Path) -> None:
    text = (site / "index.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="https?://(?!(?:squidfunk|www\.mkdocs))[^"]*\.(?:js|css|woff2?)"', text)


def test_the_python_page_has_signatures_with_types(site: Path) -> None:
    text = re.sub(r"<[^>]+>", "", (site / "python" / "index.html").read_text(encoding="utf-8"))
    for words in ("open_camera", "TrackerConfig", "RecordingLike | FrameSource", "to_pandas"):
        assert words in text.replace("&nbsp;", " "), words


def shown_commands() -> list[tuple[str, str]]:
    """Return each command line that a page shows to be typed, with the page."""
    found = []
    for page in PAGES:
        for line in page.read_text(encoding="utf-8").splitlines():
            match = re.match(r"(?: {4}|)(cuboid [a-z].*)$", line)
            if match and (line.startswith("    ") or page.name == "index.md"):
                command = match[1].split(" #")[0].strip()
                if not re.search(r"[\[|]|\.\.\.|\bNAME\b|--$", command):  # a synopsis
                    found.append((page.name, command))
    return sorted(set(found))


def named(words: list[str]) -> str:
    """Return the command of a command line."""
    return " ".join(words[1:3]) if " ".join(words[1:3]) in COMMANDS else words[1]


def test_pages_show_enough_commands() -> None:
    assert len(shown_commands()) > 40
    assert {named(shlex.split(line)) for _, line in shown_commands()} >= {
        "track",
        "info",
        "convert",
        "export",
        "render",
    }


@pytest.mark.parametrize(("page", "line"), shown_commands())
def test_a_command_that_is_shown_is_one(page: str, line: str) -> None:
    words = shlex.split(line)
    command = named(words)
    parser = argparse.ArgumentParser(exit_on_error=False, allow_abbrev=False)
    import_module(f"cuboid.cli.{command.replace(' ', '_')}").add_arguments(parser)
    _, unknown = parser.parse_known_args(without_guessing(words[1 + len(command.split()) :]))
    assert not unknown, f"{page}: {line}"


def runnable() -> list[tuple[str, str]]:
    """Return the commands that can be run on any recording and any results."""
    known = [line for _, line in shown_commands() if named(shlex.split(line)) not in NOT_RUN]
    skipped = re.compile(
        r"--camera|--live|--rerun|--to rerun|--poses estimated|--topics|--intrinsics|--register|\.bag|\.mkv|://|ROOM"
    )
    return sorted({(named(shlex.split(line)), line) for line in known if not skipped.search(line)})


@pytest.mark.parametrize(("command", "line"), runnable())
def test_a_command_that_is_shown_runs(
    command: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cuboid.run._tracker", FakeTracker)
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line)[1:]
    source = write_recording(tmp_path / "made", 4)
    if command in ("track", "info", "convert") and len(words) > 1:
        shutil.copytree(source, tmp_path / words[1])
    else:
        assert main(["track", "made", "--output", "DIR"]) == 0
    assert main(words) == 0, capfd.readouterr().err


def test_the_json_of_the_documentation_is_json() -> None:
    for page in PAGES:
        for block in re.findall(r"^    (\{.*\})$", page.read_text(encoding="utf-8"), re.MULTILINE):
            if "..." not in block and ":," not in block:
                json.loads(block)
