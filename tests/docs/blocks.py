"""The blocks of code that a page shows, each with the comments before it that say how it is run."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
SHELL = "shell"


@dataclass(frozen=True)
class Block:
    """A block of code.

    Attributes
    ----------
    page : str
        Its file, seen from the repository.
    line : int
        Of its first line, from 1.
    language : str
        Of a fenced block as the page says; ``shell`` of an indented one.
    text : str
    given : tuple of str
        What has to be there besides: ``<!-- given: NAME, NAME -->``.
    not_run : str
        Why it is only parsed: ``<!-- not run: REASON -->``; empty where it is run.
    """

    page: str
    line: int
    language: str
    text: str
    given: tuple[str, ...]
    not_run: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in their order."""
    name = page.relative_to(REPOSITORY).as_posix()
    lines = page.read_text(encoding="utf-8").splitlines()
    found: list[Block] = []
    given: tuple[str, ...] = ()
    not_run = ""
    at = 0
    while at < len(lines):
        line = lines[at]
        start = at + 1
        if comment := re.fullmatch(r"<!-- (given|not run): (.+) -->", line):
            given = tuple(comment[2].split(", ")) if comment[1] == "given" else given
            not_run = comment[2] if comment[1] == "not run" else not_run
        elif line.startswith("```"):
            at = lines.index("```", at + 1)
            found.append(Block(name, start + 1, line[3:], "\n".join(lines[start:at]), given, not_run))
            given, not_run = (), ""
        elif line.startswith("    ") and not lines[at - 1].strip():
            while at + 1 < len(lines) and (lines[at + 1].startswith("    ") or not lines[at + 1].strip()):
                at += 1
            text = "\n".join(line[4:] for line in lines[start - 1 : at + 1]).rstrip()
            found.append(Block(name, start, SHELL, text, given, not_run))
            given, not_run = (), ""
        elif line.strip() and (given or not_run):
            raise AssertionError(f"{name}:{start}: no block follows the comment that says how it is run")
        at += 1
    return found


BLOCKS = [block for page in PAGES for block in blocks_of(page)]


def commands_of(block: Block) -> list[str]:
    """Return the command lines of a block, without comments; a line that goes on is joined with the next ones."""
    joined = re.sub(r"\\\n\s*", " ", block.text)
    joined = re.sub(r" *\n {4,}(?=\S)", " ", joined)
    lines = (re.sub(r"\s+#\s.*", "", line).strip() for line in joined.splitlines())
    return [line for line in lines if line]


def is_synopsis(command: str) -> bool:
    """Tell a form of a command, with optional parts, from one that can be typed."""
    bare = re.sub(r"\"[^\"]*\"|'[^']*'", "", command)
    return re.search(r"[\[|]|\.\.\.|\bNAME\b", bare) is not None
