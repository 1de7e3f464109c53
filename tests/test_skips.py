"""In CI nothing is skipped unnoticed."""

from __future__ import annotations

from pathlib import Path

import pytest

from allowed_skips import ALLOWED_SKIPS

pytest_plugins = ["pytester"]
HERE = Path(__file__).resolve().parent


@pytest.mark.parametrize(("ci", "failed", "skipped"), [("true", 2, 0), ("", 0, 2)])
def test_a_skip_that_is_not_allowed_fails_in_ci(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, ci: str, failed: int, skipped: int
) -> None:
    monkeypatch.setenv("CI", ci)
    for name in ("conftest.py", "allowed_skips.py", "slow_files.py"):
        (pytester.path / name).write_text((HERE / name).read_text())
    pytester.makepyfile(
        test_one="import pytest\ndef test_skipped(): pytest.skip('no')\n"
        "@pytest.mark.xfail(reason='known')\ndef test_expected(): assert False",
        test_two="import pytest\npytest.skip('no', allow_module_level=True)",
    )
    outcome = pytester.runpytest_subprocess("-p", "no:cacheprovider", "--continue-on-collection-errors").parseoutcomes()
    assert outcome.get("failed", 0) + outcome.get("errors", 0) == failed
    assert outcome.get("skipped", 0) == skipped
    assert outcome["xfailed"] == 1, "an expected failure is no skip"


def test_the_list_names_tests_that_are_there() -> None:
    for beginning in ALLOWED_SKIPS:
        assert (HERE.parent / beginning).exists(), beginning
