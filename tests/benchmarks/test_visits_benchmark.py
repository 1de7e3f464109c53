from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

VISITS = Path(__file__).resolve().parents[2] / "benchmarks" / "visits.py"


def test_pairs_of_visits_are_made_tracked_and_judged(tmp_path: Path) -> None:
    words = ["--kinds", "table", "--seeds", "1", "--frames", "24", "--size", "160", "120", "--json"]
    call = [sys.executable, str(VISITS), "changes", "--work", str(tmp_path), *words]
    done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)
    assert row["place"] == "table 1"
    assert row["kept"] <= row["unmoved"]
    assert row["hidden_called_gone"] == 0
