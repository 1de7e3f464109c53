"""The release: a source distribution and a wheel that install, and the files that describe it agree on the version."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy
import pytest

import cuboid

REPOSITORY = Path(__file__).resolve().parents[2]
# The public names and the main job, with what the wheel holds and the packages that it needs.
SMOKE = """
import cuboid
assert "site" in cuboid.__file__, cuboid.__file__
for name in {names!r}:
    getattr(cuboid, name)
from cuboid.cli import main
assert main("demo --frames 12 --no-video".split()) == 0
assert cuboid.open_results("cuboid-demo/results").report.frames_used == 12
"""


# Calls a compiled kernel and one that the wheel does not have; says whether numba compiled each.
USE_KERNELS = """
import json
import numpy as np
from numba.core import event
from cuboid.ground.compiling import baseline
from cuboid.ground.compiling.compiled import KERNELS
from cuboid.ground.core.kernels import pixels
if {older}:
    baseline.binding.get_host_cpu_features = dict
depth_m, compiled = np.ones((4, 5), np.float32), []
for out in (depth_m.copy(), depth_m[:, ::-1]):  # the second is of a type that tracking never passes
    with event.install_recorder("numba:compile") as recorder:
        pixels.drop_mixed(depth_m, 1e-3, out)
    compiled.append(bool(recorder.buffer))
print(json.dumps([KERNELS["cuboid.ground.core.kernels.pixels.drop_mixed"].cache.installed, *compiled]))
"""


def said(words: Sequence[object], timeout_s: float, cwd: Path | None = None, **surroundings: object) -> str:
    """Return what a call says that succeeds without this checkout in its path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {name: str(value) for name, value in surroundings.items()}
    call = [*map(str, words)]
    done = subprocess.run(
        call, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=timeout_s
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


def build(source: Path, folder: Path, *words: str, hooks: bool) -> None:
    """Build a checkout in this environment, with the compilation of its kernels or without."""
    call = (sys.executable, "-m", "build", "--no-isolation", *words, "--outdir", folder, source)
    said(call, 300, HATCH_BUILD_NO_HOOKS=str(not hooks).lower())


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    build(REPOSITORY, folder, hooks=False)
    return folder


def test_the_wheel_has_the_package_and_nothing_else(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    assert wheel.name == f"cuboid-{cuboid.__version__}-py3-none-any.whl"
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names} == {"cuboid", f"cuboid-{cuboid.__version__}.dist-info"}
    assert "cuboid/py.typed" in names
    assert "cuboid/results/views/report/page/page.html" in names
    assert not [name for name in names if name.endswith((".nbi", ".nbc", ".pyc"))]


def test_the_source_distribution_can_be_built_and_tested(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    assert {"pyproject.toml", "LICENSE", "README.md", "requirements/dev.txt", "tests/conftest.py"} <= names


def test_the_wheel_runs_in_an_empty_environment(built: Path, tmp_path: Path) -> None:
    (wheel,) = built.glob("*.whl")
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    site = next((tmp_path / "env").rglob("site-packages"))
    zipfile.ZipFile(wheel).extractall(site)
    # The packages that it needs are those of this environment; a line in a .pth file brings no other .pth file.
    (site / "needs.pth").write_text(str(Path(numpy.__file__).parents[1]) + "\n")
    names = sorted(cuboid._PLACES)
    said([python, "-c", SMOKE.format(names=names)], 600, tmp_path)


@pytest.fixture(scope="module")
def with_kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where a wheel is unpacked that was built with compiled kernels: with one, so that it takes seconds."""
    folder = tmp_path_factory.mktemp("with-kernels")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(REPOSITORY / name, source)
    shutil.copytree(REPOSITORY / "src", source / "src", ignore=shutil.ignore_patterns("__pycache__", "lab"))
    listed = source / "src/cuboid/runs/pipeline/kernels.json"
    kernels = json.loads(listed.read_bytes())
    listed.write_text(json.dumps([one for one in kernels if one[0].endswith("pixels.drop_mixed")]))
    build(source, folder, "--wheel", hooks=True)
    (wheel,) = folder.glob("*.whl")
    assert not wheel.name.endswith("none-any.whl")
    zipfile.ZipFile(wheel).extractall(folder / "unpacked")
    return folder / "unpacked"


def used_kernels(unpacked: Path, cache: Path, *, older: bool) -> list[bool]:
    """Return whether the kernel came with the wheel, and whether it was compiled for its types, and for others."""
    words = [sys.executable, "-c", USE_KERNELS.format(older=older)]
    found: list[bool] = json.loads(said(words, 100, PYTHONPATH=unpacked, NUMBA_CACHE_DIR=cache))
    return found


@pytest.mark.parametrize("older", [False, True])
def test_kernels_that_came_with_the_wheel_are_used_where_the_processor_can_run_them(
    with_kernels: Path, tmp_path: Path, older: bool
) -> None:
    can_run = not older or platform.machine() not in ("x86_64", "AMD64")
    assert used_kernels(with_kernels, tmp_path, older=older) == [can_run, not can_run, True]


def test_damaged_kernels_of_a_wheel_are_compiled_again(with_kernels: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(with_kernels, damaged)
    for file in damaged.rglob("*.nb[ic]"):
        file.write_bytes(file.read_bytes()[:-40])
    assert used_kernels(damaged, tmp_path / "cache", older=False)[1:] == [True, True]


def test_the_files_of_the_release_name_its_version() -> None:
    version = re.escape(cuboid.__version__)
    changes = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    (first, *_) = re.findall(r"^## (.+)$", changes, re.MULTILINE)
    assert re.fullmatch(rf"{version} - \d{{4}}-\d\d-\d\d|Unreleased", first)
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^version: {version}$", citation, re.MULTILINE)
    assert re.search(r"^cff-version: 1\.2\.0$", citation, re.MULTILINE)
    assert f"cuboid-{cuboid.__version__}-py3-none-any.whl" in (REPOSITORY / "docs" / "index.md").read_text("utf-8")


def pythons(project: dict[str, Any]) -> list[str]:
    """Return the versions of Python that the classifiers name."""
    named = (re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line) for line in project["classifiers"])
    return [found[1] for found in named if found]


def test_classifiers_and_citation_agree_with_the_project() -> None:
    table = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    project, tools = table["project"], table["tool"]
    assert project["requires-python"] == f">={pythons(project)[0]}"
    assert tools["mypy"]["python_version"] == pythons(project)[0]
    assert tools["ruff"]["target-version"] == "py" + pythons(project)[0].replace(".", "")
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^license: {re.escape(project['license'])}$", citation, re.MULTILINE)
    assert f"name: {project['authors'][0]['name']}" in citation


@pytest.mark.parametrize("name", ["ci.yml", "release.yml"])
def test_the_workflows_run_what_the_project_promises(name: str) -> None:
    text = (REPOSITORY / ".github" / "workflows" / name).read_text(encoding="utf-8")
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"python: {json.dumps(pythons(project))}" in text
    promised = {
        "ci.yml": ("bash .ci/run", "windows-latest", "macos-latest", "ubuntu-latest"),
        "release.yml": (
            "run: python -m build\n",
            "--no-isolation",
            "ubuntu-24.04-arm",
            "id-token: write",
            "run: cuboid demo",
        ),
    }
    assert [words for words in promised[name] if words not in text] == []
