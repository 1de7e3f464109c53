"""What is installed from elsewhere: known weaknesses of the locked packages, and the Pythons that are promised."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
LOCK = REPOSITORY / "requirements" / "run.txt"
PYTHONS = ("3.11", "3.12", "3.13")

# All modules are imported, and a run is made with a tracker that is quick: what differs between Pythons is in those.
SMOKE = """
import importlib, pkgutil, sys
from pathlib import Path
sys.path[:0] = [{src!r}, {tests!r}]
import cuboid
for module in pkgutil.walk_packages(cuboid.__path__, "cuboid."):
    if not module.name.endswith("__main__"):
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as missing:  # an extra: what needs it is imported where it is used
            extras = {{
                "rosbags", "cyclonedds", "distributed", "dask", "pyarrow", "duckdb", "fsspec", "starlette", "mcp"
            }}
            assert missing.name.split(".")[0] in extras, missing
import cuboid.runs.pipeline.run
from cuboid.cli import main
from fakes import FakeTracker, write_recording
cuboid.runs.pipeline.run._tracker = FakeTracker
folder = Path({folder!r})
write_recording(folder / "recording", 6)
assert main(["track", str(folder / "recording"), "--output", str(folder / "out"), "--video"]) == 0
assert main(["report", str(folder / "out"), "--force"]) == 0
assert main(["export", str(folder / "out"), "--to", "json", "--output", str(folder / "out.json")]) == 0
(folder / "out" / "objects.json").write_text('{{"format": "cuboid-objects", "version": 1, "up": ' + "[" * 100_000)
assert main(["report", str(folder / "out"), "--force"]) == 2
"""


def call(*words: object, timeout_s: float = 600.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=timeout_s, check=False)


def test_no_locked_package_has_a_known_weakness(tmp_path: Path) -> None:
    venv.create(tmp_path / "audit", with_pip=False)
    python = tmp_path / "audit" / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-compile")
    if call(*pip, "-r", HERE / "requirements.txt").returncode != 0:
        pytest.skip("pip-audit cannot be installed here")
    words = ("-r", LOCK, "--require-hashes", "--disable-pip", "-f", "json", "--progress-spinner", "off")
    done = call(python, "-m", "pip_audit", *words)
    try:
        packages = json.loads(done.stdout)["dependencies"]
    except ValueError:
        pytest.skip(f"no database of weaknesses can be reached: {done.stderr.strip().splitlines()[-1:]}")
    looked_up = [package for package in packages if "skip_reason" not in package]
    if not looked_up:
        pytest.skip("no database of weaknesses can be reached: it knows none of the packages")
    weak = {package["name"]: [one["id"] for one in package["vulns"]] for package in looked_up if package["vulns"]}
    assert weak == {}


def other_pythons() -> dict[str, str]:
    """Return where each promised Python is that this one is not."""
    mine = f"{sys.version_info[0]}.{sys.version_info[1]}"
    found: dict[str, str] = {}
    for version in PYTHONS:
        places = [shutil.which(f"python{version}"), *Path.home().glob(f".pyenv/versions/{version}.*/bin/python")]
        for place in filter(None, places):
            said = call(place, "--version")
            if version != mine and re.match(rf"Python {re.escape(version)}\.", said.stdout):
                found[version] = str(place)
                break
    return found


@pytest.mark.parametrize("version", PYTHONS)
def test_it_runs_under_every_python_that_is_promised(tmp_path: Path, version: str) -> None:
    if version == f"{sys.version_info[0]}.{sys.version_info[1]}":
        return  # all other tests are of this one
    python = other_pythons().get(version)
    if python is None:
        pytest.skip(f"Python {version} is not installed")
    own = tmp_path / "own" / "bin" / "python"
    assert call(python, "-m", "venv", "--without-pip", tmp_path / "own").returncode == 0
    # Without byte code: most modules of the packages are never imported.
    pip = (sys.executable, "-m", "pip", "--python", own, "install", "-q", "--no-compile")
    installed = call(*pip, "--require-hashes", "-r", LOCK)
    if installed.returncode != 0:
        pytest.skip(f"the locked packages cannot be installed for Python {version}: {installed.stderr[-200:]}")
    code = SMOKE.format(src=str(REPOSITORY / "src"), tests=str(HERE.parent), folder=str(tmp_path))
    done = call(own, "-B", "-X", "dev", "-W", "error::SyntaxWarning", "-c", code)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
