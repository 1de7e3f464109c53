"""A store against the truths of made recordings: from result folders, and from tables alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cuboid import __version__
from cuboid.cli import main
from cuboid.lab.evaluation import evaluate
from cuboid.lab.evaluation.figures import figures
from cuboid.lab.synthetic import make_scene, render_recording


def test_the_figures_of_a_store_are_those_of_its_scenes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, store = tmp_path / "source", str(tmp_path / "store")
    for seed in (1, 2):
        render_recording(make_scene("table", seed, frames=12), source / f"table-{seed}", size=(160, 120), workers=1)
    assert main(["batch", str(source), "--output", store, "--workers", "1"]) == 0
    words = ("--tables-only", "--tag", "tables")
    assert main(["batch", str(source), "--output", store, "--workers", "1", *words]) == 0
    capsys.readouterr()
    judged = ("evaluate", "--store", store, "--truth", str(source), "--workers", "1", "--json", "-")
    versions = ("--of", f"{__version__}+tables", "--against", __version__)
    assert main([*judged, *versions]) == 0
    found = json.loads(capsys.readouterr().out)
    for name, row in found["scenes_before"].items():
        (folder,) = (tmp_path / "store" / "results" / name).iterdir()
        alone = figures(evaluate(folder, source / name))
        assert {figure: row[figure] for figure in alone} == pytest.approx(alone)
    assert found["scenes"].keys() == {"table-1", "table-2"}
    assert found["change"]["recall_25"]["same"] == 2
    assert found["change"]["hota"]["difference"]["mean"] == pytest.approx(0.0, abs=1e-3)
    assert main([*judged, "--of", "0"]) == 2
    assert "has no runs of version '0'; there are" in capsys.readouterr().err
