from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import sizes

REPOSITORY = Path(__file__).resolve().parents[2]
MODULE = '''"""A module
with a docstring of two lines.
"""

LIMIT = 3  # a constant
A, _LOW_M = 1, 0.5
NAMES: tuple[str, ...] = (
    "x",
)


def shift(points: Float64Array, by: int) -> None:
    """Move points (N, 3)."""


class Cloud:
    """A cloud."""

    def cut(self, points: npt.ArrayLike) -> int:
        """Cut it."""
        return 1

    def _hidden(self, points: npt.ArrayLike) -> None: ...
'''


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sizes, "REPOSITORY", tmp_path)
    path = tmp_path / "cloud.py"
    path.write_text(MODULE)
    return path


def test_comments_docstrings_and_empty_lines_are_no_code(module: Path) -> None:
    assert sizes.lines_of_code(module) == 10


def test_public_constants_are_statements_of_their_own(module: Path) -> None:
    assert sizes.public_constants(module) == ["LIMIT", "NAMES"]
    assert [name for name, _ in sizes.constants(module)] == ["LIMIT", "A", "_LOW_M", "NAMES"]


def test_a_number_with_two_values_is_named(module: Path) -> None:
    other = module.with_name("other.py")
    other.write_text("LIMIT = 4\nA, B = 1, 7\nNAMES = ()\n")
    assert sizes.several_values([module, other]) == {"LIMIT": ["3", "4"]}


def test_public_functions_with_arrays_state_shapes_or_not(module: Path) -> None:
    assert list(sizes.functions_with_arrays(module)) == [("cloud.py:shift", True), ("cloud.py:Cloud:cut", False)]


def test_the_counts_of_the_repository_are_printed_without_any_package() -> None:
    words = [sys.executable, "-S", str(REPOSITORY / "benchmarks" / "sizes.py")]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    counts = dict(line.strip("| ").split(" | ") for line in done.stdout.splitlines())
    assert int(counts["lines of code in src"]) > 10_000
    assert int(counts["words of README.md"]) == len((REPOSITORY / "README.md").read_text("utf-8").split())
