"""Sizes of the repository: lines of code, constants, words, and functions without shapes.

python benchmarks/sizes.py [--names]

A line of code holds a token that is neither comment nor docstring. A constant is a name in capitals that a module
assigns at its top level; a public one is a statement of its own, and its name has two letters or more. A number has
several values if modules give one name different ones. A public function or method has arrays if the annotation of an
argument names an array type, and states shapes if its docstring has one such as `(N, 3)`. `--names` lists the numbers
with several values, and the functions without shapes.
"""

from __future__ import annotations

import argparse
import ast
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from tables import markdown

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCE, METHOD = "src", "src/cuboid/method"
FRONT = ("README.md", "BENCHMARK.md", "benchmarks/history.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
NO_CODE = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
CONSTANT, PUBLIC = re.compile(r"_?[A-Z][A-Z0-9_]*"), re.compile(r"[A-Z][A-Z0-9_]+")
ARRAY = re.compile(r"\b(NDArray|ndarray|\w*Array|ArrayLike)\b")
SCALAR_FUNCTIONS = ("np.radians", "np.cos", "np.sin", "np.log", "np.sqrt", "float", "int")
SHAPE = re.compile(r"\((?:(?:\w+|\.\.\.), ?)+\w+\)|\(\w+,\)")


def python_files(folder: str) -> Iterator[Path]:
    """Iterate over the modules below a folder of the repository."""
    return iter(sorted((REPOSITORY / folder).rglob("*.py")))


def lines_of_code(path: Path) -> int:
    """Return the number of lines with a token that is neither comment nor docstring."""
    code = set[int]()
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in NO_CODE:
                code.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            code.difference_update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(code)


def _assignments(path: Path) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Iterate over the targets that a module assigns at its top level, with their values."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign):
            yield from ((target, node.value) for target in node.targets)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield node.target, node.value


def public_constants(path: Path) -> list[str]:
    """Return the public names in capitals that a module assigns, each in a statement of its own."""
    names = (target.id for target, _ in _assignments(path) if isinstance(target, ast.Name))
    return [name for name in names if PUBLIC.fullmatch(name)]


def constants(path: Path) -> list[tuple[str, ast.expr]]:
    """Return all names in capitals that a module assigns, private ones and parts of tuples included, with values."""
    pairs = (pair for target, value in _assignments(path) for pair in _paired(target, value))
    return [(name, value) for name, value in pairs if CONSTANT.fullmatch(name)]


def _paired(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """Pair the names of an assignment with their values: `A, B = 1, 2` has two."""
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple):
        parts = value.elts if isinstance(value, ast.Tuple) else [value] * len(target.elts)
        for one, part in zip(target.elts, parts, strict=True):
            yield from _paired(one, part)


def several_values(paths: Iterable[Path]) -> dict[str, list[str]]:
    """Return the names of numbers that modules give different values, with these values."""
    found = defaultdict[str, set[str]](set)
    for path in paths:
        for name, value in constants(path):
            if _is_number(value):
                found[name].add(ast.unparse(value))
    return {name: sorted(values) for name, values in sorted(found.items()) if len(values) > 1}


def _is_number(value: ast.expr) -> bool:
    """Tell whether an expression is made of numbers alone: `0.5`, `-3`, `1 << 20`, `np.radians(5.0)`."""
    if isinstance(value, ast.Call):
        return ast.unparse(value.func) in SCALAR_FUNCTIONS and all(map(_is_number, value.args))
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    return isinstance(value, ast.Constant) and isinstance(value.value, int | float)


def functions_with_arrays(path: Path) -> Iterator[tuple[str, bool]]:
    """Iterate over the public functions and methods with array arguments; tell whether docstrings state shapes."""
    yield from _in_body(ast.parse(path.read_text(encoding="utf-8")).body, path.relative_to(REPOSITORY).as_posix())


def _in_body(body: Iterable[ast.stmt], where: str) -> Iterator[tuple[str, bool]]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _in_body(node.body, f"{where}:{node.name}")
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and _takes_arrays(node):
            yield f"{where}:{node.name}", SHAPE.search(ast.get_docstring(node) or "") is not None


def _takes_arrays(function: ast.FunctionDef) -> bool:
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return any(one.annotation is not None and ARRAY.search(ast.unparse(one.annotation)) for one in arguments)


def words(*paths: Path) -> int:
    """Return the number of words of pages, as `wc -w` counts them."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in paths)


def rows() -> list[tuple[str, object]]:
    """Return what is counted, and the counts."""
    source = list(python_files(SOURCE))
    functions = [found for path in source for found in functions_with_arrays(path)]
    pages = sorted((REPOSITORY / "docs").rglob("*.md"))
    front = [REPOSITORY / name for name in FRONT]
    return [
        ("lines of code in src", sum(map(lines_of_code, source))),
        ("lines of code in tests", sum(map(lines_of_code, python_files("tests")))),
        ("lines of code in benchmarks", sum(map(lines_of_code, python_files("benchmarks")))),
        ("public constants in src", sum(len(public_constants(path)) for path in source)),
        (f"... in {METHOD}", sum(len(public_constants(path)) for path in python_files(METHOD))),
        ("... with private ones and parts of tuples", sum(len(constants(path)) for path in source)),
        ("names of numbers with several values", len(several_values(source))),
        ("public functions with arrays", len(functions)),
        ("... whose docstring states shapes", sum(stated for _, stated in functions)),
        ("pages in docs", len(pages)),
        ("words of the pages in docs", words(*pages)),
        *((f"words of {name}", words(path)) for name, path in zip(FRONT, front, strict=True)),
        ("words in all", words(*pages, *front)),
    ]


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--names", action="store_true", help="list the names behind the counts")
    args = parser.parse_args()
    print(markdown(["count", "number"], rows()))
    if args.names:
        for name, values in several_values(python_files(SOURCE)).items():
            print(f"{name}: {'; '.join(values)}")
        for path in python_files(SOURCE):
            for name, stated in functions_with_arrays(path):
                if not stated:
                    print(f"no shapes: {name}")


if __name__ == "__main__":
    main()
