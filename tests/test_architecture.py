"""The rules of the architecture that a machine can check."""

from __future__ import annotations

import ast
import dataclasses
import re
import tomllib
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from cuboid.method.objects.entry import MapObject, ObjectWithoutDepth

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCE = REPOSITORY / "src" / "cuboid"

# The rooms of `src/cuboid` and the packages in each, in the order of the data: each imports only those before it.
ROOMS = {
    "ground": ("compiling", "geometry", "core", "formats", "middleware"),
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
# Modules that stand in a room without a package, below its packages.
GROUND = {"arrays.py", "locks.py", "version.py"}
PACKAGES = [f"cuboid.{room}.{package}" for room, packages in ROOMS.items() for package in packages] + ["cuboid.cli"]
MODULES = {
    ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in SOURCE.glob("**/*.py")
}


# The only modules that change an object, and the attributes of an object.
STORE = SOURCE / "method" / "objects" / "store"
ATTRIBUTES = {field.name for cls in (MapObject, ObjectWithoutDepth) for field in dataclasses.fields(cls)}
# Methods that change a list, a dict, a set or an array in place.
IN_PLACE = {
    *("add", "append", "clear", "discard", "extend", "fill", "insert", "pop", "popitem", "remove", "resize"),
    *("reverse", "setdefault", "sort", "update"),
}
# Owners of attributes with these names that are no objects: a class itself, rows of a scene, and `OwnFrames`.
OTHER_OWNERS = {"self", "self._rows", "renumbered", "detect"}


def changes_of_objects(code: str) -> list[str]:
    """Return the expressions in a module that change an object of the map."""
    found = []
    for node in ast.walk(ast.parse(code)):
        target: ast.AST = node
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called.split(".")[-1] in ("setattr", "delattr", "__setattr__", "__delattr__"):
                found.append(called)
            if re.search(r"\baffinity\.(add_\w+|transfer|remove)$", called):
                found.append(called)
            if not isinstance(node.func, ast.Attribute) or node.func.attr not in IN_PLACE:
                continue
            target = node.func.value
        elif not isinstance(getattr(node, "ctx", None), ast.Store | ast.Del):
            continue
        while isinstance(target, ast.Subscript):
            target = target.value
        is_attribute = isinstance(target, ast.Attribute) and target.attr in ATTRIBUTES
        if is_attribute and ast.unparse(target.value) not in OTHER_OWNERS:
            found.append(ast.unparse(node))
    return found


def floor(module: str) -> int:
    """Return the place of a module's package in the order; the ground's own modules are below all, `cuboid` above."""
    package = next((k for k, name in enumerate(PACKAGES) if f"{module}.".startswith(f"{name}.")), -1)
    return len(PACKAGES) if module in ("cuboid", "cuboid.__main__") else package


def imports_of(module: str) -> set[str]:
    """Return the modules of this package that a module imports: at its top, in functions, for type checkers."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.module, f"{module} has a relative import"
            named = (f"{node.module}.{alias.name}" for alias in node.names)
            names.update(name if name in MODULES else node.module for name in named)
        elif isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
    return names & MODULES.keys()


def modules_in_strings(module: str) -> set[str]:
    """Return the modules of this package that a module names in a string, as `import_module` takes it."""
    nodes = ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8")))
    texts = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    return texts & MODULES.keys() - {"cuboid"}


IMPORTS = {module: imports_of(module) for module in MODULES}


def test_every_package_has_its_place() -> None:
    assert {path.parent.name for path in SOURCE.glob("*/__init__.py")} == set(ROOMS)
    assert {path.name for path in SOURCE.glob("*.py")} == {"__init__.py", "__main__.py"}
    for room, packages in list(ROOMS.items())[:-1]:
        assert {path.parent.name for path in (SOURCE / room).glob("*/__init__.py")} == set(packages), room
        alone = {path.name for path in (SOURCE / room).glob("*.py")}
        assert alone == {"__init__.py"} | (GROUND if room == "ground" else set()), room


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_those_before_it(package: str) -> None:
    for module in MODULES:
        if f"{module}.".startswith(f"{package}."):
            named = IMPORTS[module] | modules_in_strings(module)
            later = {name for name in named if floor(name) > floor(module)}
            assert not later, f"{module} imports {', '.join(sorted(later))}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    try:
        TopologicalSorter(IMPORTS).prepare()
    except CycleError as error:
        pytest.fail(" is imported by ".join(error.args[1]))


def paths_in(page: Path) -> set[str]:
    """Return the paths under `src/cuboid` that a page names in backquotes; of `a/{b,c}.py` each."""
    found = re.findall(rf"`((?:{'|'.join(ROOMS)})/[^`<]*)`", page.read_text(encoding="utf-8"))
    parts = (re.match(r"([^{]*)(?:{([^}]*)})?(.*)", path) for path in found)
    return {f"{part[1]}{name}{part[3]}" for part in parts if part for name in (part[2] or "").split(",")}


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "docs/method.md", "docs/method-details.md"])
def test_the_files_that_a_page_names_are_there(name: str) -> None:
    named = paths_in(REPOSITORY / name)
    assert len(named) > 10
    assert {path for path in named if not (SOURCE / path).exists()} == set()


def rows_of_changes() -> list[tuple[str, list[str]]]:
    """Return the rows of the table in CONTRIBUTING that tells where to change what: the change, and the names."""
    page = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8")
    lines = page.split("| change | files |\n|---|---|\n")[1].split("\n\n")[0].splitlines()
    cells = [line.strip("| ").split(" | ") for line in lines]
    return [(change, re.findall(r"`([^`]+)`", files)) for change, files in cells]


def test_each_change_is_made_in_one_to_three_files_that_hold_the_named_code() -> None:
    rows = rows_of_changes()
    assert len(rows) >= 10
    for change, names in rows:
        paths = [name for name in names if "/" in name]
        assert 1 <= len(paths) <= 3, change
        whole = [(REPOSITORY if path.startswith(("docs/", "benchmarks/")) else SOURCE) / path for path in paths]
        for path in whole:
            assert path.exists() or (path.name.startswith("<") and path.parent.is_dir()), f"{change}: {path}"
        code = "\n".join(path.read_text(encoding="utf-8") for path in whole if path.is_file())
        missing = [name for name in names if "/" not in name and not re.search(rf"\b{name}\b", code)]
        assert not missing, f"{change}: {missing}"


@pytest.mark.parametrize("package", PACKAGES[PACKAGES.index("cuboid.method.objects") :])
def test_only_the_store_changes_an_object(package: str) -> None:
    for path in sorted((SOURCE.parent / package.replace(".", "/")).glob("**/*.py")):
        if STORE in path.parents or path == SOURCE / "cli" / "__init__.py":  # that one sets streams of `sys`
            continue
        found = changes_of_objects(path.read_text(encoding="utf-8"))
        assert not found, f"{path.relative_to(SOURCE)} changes an object: {', '.join(found)}"


@pytest.mark.parametrize(
    "code",
    [
        "entry.log_odds -= 1.0",
        "entry.box, other = box, 1",
        "self._entry_of(k).label: int = 3",
        "entry.outline[0, 1] = 5.0",
        "del entry.supports[3]",
        "entry.merged_labels.append(4)",
        "for entry.label in labels: pass",
        "setattr(entry, name, value)",
        "object.__setattr__(entry, 'label', 3)",
        "self.store.affinity.add_evidence(1, 2, 1.4, novelty=1.0)",
    ],
)
def test_a_change_outside_the_store_is_noticed(code: str) -> None:
    assert changes_of_objects(code)


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
    for requirement in map(Requirement, extras["dev"] if name == "dev.txt" else extras["synth"] + extras["build"]):
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
