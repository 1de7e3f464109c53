from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SUITE = Path(__file__).resolve().parents[2] / "benchmarks" / "suite.py"


def run_suite(*arguments: str) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, str(SUITE), *arguments]
    return subprocess.run(call, capture_output=True, text=True, check=False, timeout=300)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("suite")


@pytest.fixture(scope="module")
def rows(work: Path) -> list[dict[str, float]]:
    done = run_suite("--work", str(work), "--short", "--jobs", "2", "--json")
    assert done.returncode == 0, done.stderr
    found: list[dict[str, float]] = json.loads(done.stdout)
    return found


def test_short_scenes_are_mapped_and_keep_their_labels(rows: list[dict[str, float]]) -> None:
    assert [row["kind"] for row in rows] == ["table", "leave"]
    for row in rows:
        assert row["recall_50"] >= 0.8, row
        assert row["precision_50"] >= 0.8, row
        assert row["idf1_25"] >= 0.6, row  # 45 frames: a label takes a good part of them to come
        assert row["switches"] <= 1, row
        assert row["fragments"] <= 1, row


def results(work: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in work.glob("store/results/*/*/objects.json")}


def test_what_is_done_is_not_done_again(work: Path, rows: list[dict[str, float]]) -> None:
    before = results(work)
    assert len(before) == 2
    done = run_suite("--work", str(work), "--short", "--jobs", "1")
    assert results(work) == before
    table = done.stdout.splitlines()
    assert [line.split("|")[1].strip() for line in table] == ["kind", "---", "table", "leave", "all"]
    assert table[-1].split("|")[2].strip() == "2"


def test_other_settings_are_other_results(work: Path, rows: list[dict[str, float]]) -> None:
    done = run_suite("--work", str(work), "--short", "--kinds", "table", "--jobs", "1", "--every", "9", "--json")
    assert done.returncode == 0, done.stderr
    assert len(results(work)) == 3
    assert json.loads(done.stdout)[0]["frames"] == 5


def test_a_wrong_call_is_answered_in_one_line(tmp_path: Path) -> None:
    done = run_suite("--work", str(tmp_path), "--short", "--set", "voxels=3")
    assert done.returncode == 2
    assert done.stderr.startswith("suite: unknown setting 'voxels'")
    assert done.stderr.count("\n") == 1
