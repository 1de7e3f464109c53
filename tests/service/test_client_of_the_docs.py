"""The client that the documentation shows, run while a place is served."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from made_place import write_place
from served import served

PAGE = Path(__file__).resolve().parents[2] / "docs" / "questions.md"


def test_it_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (code,) = [block for block in blocks if "urlopen" in block]
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    with served(str(write_place(tmp_path))) as address:
        exec(code.replace("http://localhost:8765", address), {})
    objects, seen, free = capsys.readouterr().out.splitlines()
    assert objects.count("'label'") == 2
    assert "'crate'" in seen
    assert "'plane:1'" in free
