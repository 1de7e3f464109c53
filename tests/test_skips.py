"""The list of tests that may be skipped in CI names tests that are there."""

from __future__ import annotations

from pathlib import Path

from allowed_skips import ALLOWED_SKIPS

REPOSITORY = Path(__file__).resolve().parents[1]


def test_the_list_names_tests_that_are_there() -> None:
    for beginning in ALLOWED_SKIPS:
        assert (REPOSITORY / beginning).exists(), beginning
