"""The rules of the architecture that a machine can check."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCE = REPOSITORY / "src" / "cuboid"

# Rooms of `src/cuboid`, and the packages in each.
ROOMS = {
    "ground": ("geometry", "core", "formats", "middleware"),
    "inputs": ("readers", "calibration", "recordings", "cameras"),
    "method": (
        *("poses", "detection", "proposals", "heatmap", "surfaces", "boxes", "objects"),
        *("relations", "shapes", "text_search"),
    ),
    "results": ("files", "views", "exports"),
    "runs": ("tracking", "scene", "pipeline"),
    "services": ("queries", "service", "ros2"),
    "lab": ("synthetic", "evaluation", "annotation"),
    "fleet": ("store", "batch"),
    "cli": (),
}
# All packages in the order of the data's path: each imports only those before it.
PACKAGES = (
    *("geometry", "core", "formats", "middleware", "readers", "poses", "detection", "proposals", "heatmap", "surfaces"),
    *("boxes", "objects", "shapes", "relations", "text_search", "files", "views", "calibration", "tracking", "scene"),
    *("pipeline", "recordings", "cameras", "ros2", "exports", "synthetic", "evaluation", "annotation", "queries"),
    *("store", "service", "batch", "cli"),
)
ROOM_OF = {package: room for room, packages in ROOMS.items() for package in packages}
# These two know each other: a frame has a rigid pose, and geometry names the arrays that it works on.
GROUND = {"geometry", "core"}


def imported_packages(path: Path) -> set[str]:
    """Return the packages that a module imports, at its top or inside."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
        elif isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
    found = [name.split(".") for name in names if name.startswith("cuboid.")]
    return {parts[1] if parts[1] == "cli" else parts[2] for parts in found}


def test_every_package_has_its_place() -> None:
    assert {path.parent.name for path in SOURCE.glob("*/__init__.py")} == set(ROOMS)
    for room, packages in ROOMS.items():
        assert {path.parent.name for path in (SOURCE / room).glob("*/__init__.py")} == set(packages), room
    assert {path.name for path in SOURCE.glob("*.py")} == {"__init__.py", "__main__.py"}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_those_before_it(package: str) -> None:
    later = {*PACKAGES[PACKAGES.index(package) + 1 :]} - (GROUND if package in GROUND else set())
    for path in sorted((SOURCE / ROOM_OF.get(package, "") / package).glob("**/*.py")):
        wrong = imported_packages(path) & later
        assert not wrong, f"{path.relative_to(SOURCE)} imports {', '.join(sorted(wrong))}"


@pytest.mark.parametrize("name", ["run.txt", "dev.txt"])
def test_the_lock_has_every_requirement_with_a_hash_and_no_address(name: str) -> None:
    text = (REPOSITORY / "requirements" / name).read_text(encoding="utf-8")
    assert not re.search(r"https?:|file:|--(extra-)?index|--find-links", text)
    locked: dict[str, list[str]] = {}
    for block in re.split(r"\n(?=\S)", text.strip()):
        requirement = Requirement(block.split("\\")[0].strip())
        locked.setdefault(requirement.name, []).append(str(requirement.specifier).removeprefix("=="))
        assert "--hash=sha256:" in block, requirement.name
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*map(Requirement, project["dependencies"])]
    for requirement in map(Requirement, extras["dev"] if name == "dev.txt" else extras["synth"]):
        own = requirement.name == project["name"]  # extras of this package
        wanted += [Requirement(one) for extra in requirement.extras for one in extras[extra]] if own else [requirement]
    for requirement in wanted:
        versions = locked.get(requirement.name, [])
        assert versions, f"{requirement.name} is not locked"
        assert all(requirement.specifier.contains(version) for version in versions), requirement.name


def test_ci_runs_the_line_of_the_readme() -> None:
    line = (REPOSITORY / ".ci" / "run").read_text(encoding="utf-8").splitlines()[-1]
    assert line.startswith("python3 -m venv")
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert line in [shown.strip() for shown in readme.splitlines()]
