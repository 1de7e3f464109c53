"""How a missing package is installed is said in one form in the program, and on one page of the documentation."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from cuboid.ground.core.errors import MissingExtraError
from cuboid.ground.core.extras import how_to_install, need_cluster, require

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCE = REPOSITORY / "src" / "cuboid"
EXTRAS = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
INSTALL = REPOSITORY / "docs" / "index.md"
# Functions that word the message, and where in their call the extra stands.
WORDED_BY = {"require": 2, "library": 2, "missing": 2, "how_to_install": 0}


def test_the_message_names_package_extra_and_call() -> None:
    with pytest.raises(MissingExtraError) as raised:
        require("no_such_package.part", "cuboid fly", "ros")
    assert str(raised.value) == (
        "'cuboid fly' needs no_such_package, which is not installed: "
        "install the extra 'ros': pip install '.[ros]' in a checkout of Cuboid"
    )
    assert how_to_install(pip="pandas") == "pip install pandas"


def test_all_missing_packages_of_the_cluster_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cuboid.ground.core.extras.CLUSTER", ("numpy", "no_such_package", "nor_this"))
    with pytest.raises(MissingExtraError, match=r"needs no_such_package, nor_this, which are not installed: .*cluster"):
        need_cluster("cuboid batch")


def named_extras(tree: ast.AST) -> Iterator[str]:
    """Return the extras that the calls in a module name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in WORDED_BY:
            for argument in node.args[WORDED_BY[node.func.id] :][:1]:
                if isinstance(argument, ast.Constant):
                    yield argument.value


def test_the_program_has_one_wording_and_names_extras_that_there_are() -> None:
    worded, named = set(), set()
    for file in SOURCE.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        worded |= {file.name} if "pip install" in text or "cuboid[" in text else set()
        named |= set(named_extras(ast.parse(text)))
    assert worded == {"extras.py"}
    assert named <= set(EXTRAS)
    assert len(named) >= 8


def test_the_documentation_says_it_on_one_page() -> None:
    pages = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *(REPOSITORY / "docs").rglob("*.md")]
    other = re.compile(r"(?<!bin/)pip install|cuboid\[")  # .venv/bin/pip sets up a checkout
    assert [page for page in pages if page != INSTALL and other.search(page.read_text(encoding="utf-8"))] == []


def test_the_page_lists_every_extra() -> None:
    text = INSTALL.read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == set(EXTRAS)
    asked = set(",".join(re.findall(r"(?:'\.|\.whl)\[([\w,]+)\]'", text)).split(","))
    assert asked <= set(EXTRAS)


def test_the_page_has_the_line_of_the_readme() -> None:
    line = next(line for line in INSTALL.read_text(encoding="utf-8").splitlines() if "requirements/run.txt" in line)
    assert line in (REPOSITORY / "README.md").read_text(encoding="utf-8").splitlines()
