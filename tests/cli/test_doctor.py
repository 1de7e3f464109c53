from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from cuboid.cli import doctor, main
from cuboid.ground.core.extras import how_to_install


def lines_of(capsys: pytest.CaptureFixture[str]) -> dict[str, tuple[str, str]]:
    """Return state and detail by the name of the check."""
    found = {}
    for line in capsys.readouterr().out.splitlines():
        state, rest = line.split(maxsplit=1)
        name, _, detail = rest.partition("  ")
        found[name] = (state, detail.strip())
    return found


def test_a_sound_installation(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    lines = lines_of(capsys)
    assert {"numpy", "numba", "opencv contrib", "kernels", "kernel cache", "temporary folder"} <= set(lines)
    assert {state for state, _ in lines.values()} <= {"ok", "missing"}
    ready, _, total, *_ = lines["kernels"][1].split()
    assert 0 <= int(ready) <= int(total)
    assert int(total) >= 5


def without(monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    def load(name: str) -> Any:
        if name == missing:
            raise ImportError(f"No module named '{name}'")
        return import_module(name)

    monkeypatch.setattr(doctor, "import_module", load)


def test_a_missing_package_fails_and_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "msgspec")
    assert main(["doctor"]) == 1
    assert lines_of(capsys)["msgspec"] == ("BAD", "cannot be imported: No module named 'msgspec'")


def test_a_missing_extra_is_no_fault_and_says_how_to_get_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "onnxruntime")
    assert main(["doctor"]) == 0
    assert lines_of(capsys)["extra onnx"] == ("missing", f"needs onnxruntime: {how_to_install('onnx')}")


def test_an_extra_that_is_there_in_part_names_what_it_needs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "trimesh")
    assert main(["doctor"]) == 0
    lines = lines_of(capsys)
    for extra in ("synth", "shapes"):  # a package of two extras
        state, detail = lines[f"extra {extra}"]
        assert state == "missing"
        assert "trimesh" in detail
        assert detail.endswith(how_to_install(extra))


def test_each_extra_is_one_line_with_its_packages(capsys: pytest.CaptureFixture[str]) -> None:
    project = Path(__file__).resolve().parents[2] / "pyproject.toml"
    extras = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    wanted = {
        name: [canonicalize_name(Requirement(item).name) for item in extras[name]] for name in extras if name != "dev"
    }
    assert {name: [package for package, _ in packages] for name, packages in doctor.EXTRAS.items()} == wanted
    assert main(["doctor"]) == 0
    shown = [line.split()[2] for line in capsys.readouterr().out.splitlines() if line.split()[1] == "extra"]
    assert shown == list(doctor.EXTRAS)
