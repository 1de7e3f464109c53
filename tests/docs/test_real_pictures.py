"""Pictures of real recordings: in the pages where they were drawn, and nowhere else."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture
def hook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The hook of the site, whose pictures lie elsewhere."""
    spec = importlib.util.spec_from_file_location("real_pictures", DOCS / "real_pictures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "REAL", tmp_path)
    return module


def page(hook: ModuleType, name: str) -> str:
    """A page as the site gets it."""
    text = (DOCS / name).read_text(encoding="utf-8")
    return str(hook.on_page_markdown(text, SimpleNamespace(file=SimpleNamespace(src_uri=name))))


def test_without_them_the_pages_show_made_ones(hook: ModuleType) -> None:
    assert "gallery/real" not in page(hook, "results.md")
    assert "(gallery/look-at-heat.jpg)" in page(hook, "finds-nothing.md")


def test_those_that_are_there_are_shown(hook: ModuleType, tmp_path: Path) -> None:
    sheet = {"name": "desk", "title": "A desk", "source": "Recording: somebody's."}
    (tmp_path / "index.json").write_text(json.dumps([sheet]))
    (tmp_path / "look-at-heat.jpg").write_bytes(b"")
    gallery, nothing = page(hook, "results.md"), page(hook, "finds-nothing.md")
    assert (
        "### A desk\n\n![Labels, heat, own boxes, planes](gallery/real/desk.jpg)\n\nRecording: somebody's." in gallery
    )
    assert "(gallery/real/look-at-heat.jpg)" in nothing
    assert "(gallery/look-at-planes.jpg)" in nothing
