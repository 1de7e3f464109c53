from __future__ import annotations

import ast
import inspect
import pydoc
import re
from pathlib import Path

import pytest

import cuboid

PAGE = Path(__file__).resolve().parents[1] / "docs" / "python.md"


def exported() -> set[str]:
    """Return the public names that type checkers see: those of `import X as X`."""
    tree = ast.parse(inspect.getsource(cuboid))
    aliases = [alias for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names]
    return {alias.name for alias in aliases if alias.name == alias.asname and not alias.name.startswith("_")}


PUBLIC = sorted(name for name in dir(cuboid) if not name.startswith("_"))


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_is_there_and_described(name: str) -> None:
    value = getattr(cuboid, name)
    assert value is not None
    assert cuboid.__doc__ is not None
    assert re.search(rf"\b{name}\b", cuboid.__doc__), "the module's docstring lists it"
    sections = re.findall(r"^::: cuboid\.[\w.]+\.(\w+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sections.count(name) == 1, "docs/python.md has one section for it"


def test_type_checkers_see_the_same_names() -> None:
    assert exported() == set(PUBLIC)


def returned_types() -> set[str]:
    """Return the classes of ours that stand in the return types of the queries of a map."""
    queries = Path(cuboid.__file__).parent / "results" / "files" / "queries.py"
    names, ours = set(), set()
    for node in ast.walk(ast.parse(queries.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cuboid"):
            ours |= {alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and node.returns is not None:
            names |= {part.id for part in ast.walk(node.returns) if isinstance(part, ast.Name)}
    return names & ours


def test_what_a_query_returns_is_public() -> None:
    assert {"ObjectMesh", "Relation", "Wall"} <= returned_types() <= {*PUBLIC, "Float32Array", "Float64Array"}


def test_another_name_is_not() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = cuboid.nothing


def test_help_is_short() -> None:
    shown = pydoc.render_doc(cuboid, renderer=pydoc.plaintext)
    assert len(shown.splitlines()) <= 90
    assert "open_results" in shown
