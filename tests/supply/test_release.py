"""The release: a source distribution and a wheel that install, and the files that describe it agree on the version."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

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
words = "synth --kind table --seed 3 --frames 12 --size 160x120 --output made".split()
assert main(words) == 0
assert main(["track", "made", "--output", "results"]) == 0
assert cuboid.open_results("results").report.frames_used == 12
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    words = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(REPOSITORY)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
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
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-c", SMOKE.format(names=names)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_files_of_the_release_name_its_version() -> None:
    version = re.escape(cuboid.__version__)
    changes = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    (first, *_) = re.findall(r"^## (.+)$", changes, re.MULTILINE)
    assert re.fullmatch(rf"{version} - \d{{4}}-\d\d-\d\d|Unreleased", first)
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^version: {version}$", citation, re.MULTILINE)
    assert re.search(r"^cff-version: 1\.2\.0$", citation, re.MULTILINE)
    assert f"cuboid-{cuboid.__version__}-py3-none-any.whl" in (REPOSITORY / "docs" / "install.md").read_text("utf-8")


def test_the_workflow_runs_what_the_project_promises() -> None:
    text = (REPOSITORY / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    assert "bash .ci/run" in text
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for line in project["classifiers"]:
        if found := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line):
            assert f'"{found[1]}"' in text, line
    for system in ("ubuntu", "macos", "windows"):
        assert f"{system}-latest" in text
