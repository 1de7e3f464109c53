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


def test_the_counts_of_a_repository(module: Path) -> None:
    root = module.parent
    for name in ("src/cuboid/method/cloud.py", "tests/test_cloud.py", "docs/page.md", *sizes.FRONT):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(MODULE if name.endswith(".py") else "# Three short words\n")
    counts = dict(sizes.rows())
    assert (counts["lines of code in src"], counts["lines of code in tests"]) == (10, 10)
    assert (counts["public constants in src"], counts["... in src/cuboid/method"]) == (2, 2)
    assert (counts["public functions with arrays"], counts["... whose docstring states shapes"]) == (2, 1)
    assert (counts["pages in docs"], counts["words of README.md"]) == (1, 4)
    assert counts["words in all"] == 4 * (1 + len(sizes.FRONT))


def test_it_needs_no_package() -> None:
    words = [sys.executable, "-S", str(REPOSITORY / "benchmarks" / "sizes.py"), "--help"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
