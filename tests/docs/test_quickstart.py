"""The notebook of the documentation is executed, cell by cell, with a short recording."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from blocks import REPOSITORY

NOTEBOOK = REPOSITORY / "docs" / "quickstart.ipynb"


def cells() -> list[str]:
    document = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert document["nbformat"] == 4
    return ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "code"]


def test_the_notebook_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {}
    for k, text in enumerate(cells()):
        text = text.replace("FRAMES = 60 ", "FRAMES = 24 ")
        tree = ast.parse(text, f"cell {k}")
        exec(compile(tree, f"cell {k}", "exec"), scope)
    assert len(scope["tracker"].objects) >= 3  # type: ignore[attr-defined]
    assert (tmp_path / "notebook-results" / "report.html").is_file()
    assert (tmp_path / "notebook-object.ply").stat().st_size > 1000
    assert "near the first object:" in capsys.readouterr().out


def test_the_notebook_holds_no_outputs_and_its_links_exist() -> None:
    document = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert not any(cell.get("outputs") for cell in document["cells"])
    text = "".join("".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "markdown")
    for page in [part.split(")")[0] for part in text.split("](")[1:]]:
        assert (NOTEBOOK.parent / page).is_file(), page
