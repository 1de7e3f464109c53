"""The list of slow test files names files that are there, so that the fast tier leaves out no more than it says."""

from __future__ import annotations

from pathlib import Path

from slow_files import SLOW_FILES

TESTS = Path(__file__).parent


def test_every_slow_file_is_there_and_most_files_are_fast() -> None:
    files = {str(path.relative_to(TESTS)) for path in TESTS.rglob("test_*.py")}
    assert files >= SLOW_FILES, sorted(SLOW_FILES - files)
    assert len(files - SLOW_FILES) > len(SLOW_FILES)
