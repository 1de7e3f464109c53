"""How many numbers the method is tuned by, from proposals to labels: never more than before.

`python tests/test_constants.py` prints them.

Counted is each number that somebody chose, once: named ones at the head of a file, those inside of functions, factors
in what is computed from others, and the defaults of settings. Not counted: 0, 1, 2 and a half inside of functions (a
sign, a middle, a double), indices, shapes, ranges, powers, shifts and channels, guards of at most 1e-6 against a
division by zero, what is computed from other constants, and what `NO_CHOICE` names: no result depends on it, or it is
no choice. Of the sources of 2D proposals the one that is built in counts: the others stand for what they wrap.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "cuboid"
# Lower it whenever there are fewer.
MOST = 100
FILES = (
    *("config.py", "sensor.py", "tolerances.py", "tracker.py", "working.py", "proposals/depth.py"),
    *(f"{folder}/*.py" for folder in ("heatmap", "surfaces", "boxes", "objects", "kernels")),
)
# Kernels of what comes before proposals (poses, registration, calibration); where rows lie in memory, and when; how
# boxes overlap.
ELSEWHERE = {
    *("kernels/align.py", "kernels/edges.py", "kernels/registration.py", "kernels/overlap.py"),
    *("kernels/cubes.py", "kernels/lookup.py", "kernels/levels.py", "heatmap/levels.py"),
    *("heatmap/row_memory.py", "heatmap/block_store.py", "heatmap/stored_points.py", "heatmap/moving_points.py"),
}
NO_CHOICE = {
    "boxes/fit.py": {"_NO_SIDE": "empty", "_NO_TRUST": "empty"},
    "boxes/hidden.py": {"MIN_GAP_M": "rounds off the last bits", "SOME_OF_NINE": "of a block"},
    "heatmap/voxel_map.py": {"VoxelMap: 255": "the largest of its type"},
    "kernels/bodies.py": {"fit_trimmed: 1.48": "a deviation by the median of absolute residuals"},
    "kernels/cells.py": {"CELL_COLUMNS": "of a table", "level_patches: 1.42": "of two readings"},
    "kernels/claims.py": {"REMEMBERED": "how pairs are collected"},
    "kernels/extents.py": {"BINS": "finer changes nothing", "best_turn: 9": "rounds off the last bits",
                           "side_spread: 3": "the fourth of four sides"},
    "kernels/holes.py": {"sweep: 1.4": "a diagonal step"},
    "kernels/outlines.py": {"KINDS": "of an enumeration"},
    "kernels/patches.py": {"solve3: 0.001": "guards a division, in pixels squared"},
    "kernels/regions.py": {"COLUMNS": "of a table", "BACKGROUND": "a mark"},
    "kernels/resting.py": {"ALIKE_M": "rounds off the last bits", "MIN_M": "no box is empty"},
    "kernels/revolve.py": {"fit_axis: 1.25": "a deviation by the mean of absolute residuals"},
    "kernels/segments.py": {"PLACE_BITS": "how a pixel is written", "RIGHT": "bit", "DOWN": "bit", "CREASE": "bit",
                            "NONE": "a mark", "PLANE": "a mark", "SURFACE": "a mark", "FAR": "a mark",
                            "mark: 3": "a diagonal step"},
    "kernels/unions.py": {"distinct: 0.99": "rounds off the last bits"},
    "kernels/voxels.py": {"MAX_HITS": "the largest of its type", "running_mean: 65535": "the largest of its type",
                          "pixel_weights: 4.0": "pixels of a block",
                          "pixel_weights: 16.0": "pixels of a block of blocks", "LAST_CUBES": "how cubes are found"},
    "proposals/depth.py": {"MIN_WIDE": "a range", "NEIGHBOURS": "Euler's formula", "_scores: 4.0": "of pi"},
    "surfaces/grid.py": {"LIMIT_CELLS": "memory", "SLACK_CELLS": "how windows grow",
                         "SLACK_FRACTION": "how windows grow",
                         "WHOLE_CELLS": "how much is done anew", "AROUND_CELLS": "how much is done anew"},
    "surfaces/up.py": {"TURNS": "the four quarter turns", "UpVote: 5": "columns of a table"},
    "tracker.py": {"Stopwatch: 1000.0": "milliseconds"},
    "working.py": {"_PHASES": "all four"},
}  # fmt: skip
PLAIN = {0, 1, 2, 0.5}
SHAPES = {"zeros", "empty", "ones", "full", "eye", "reshape", "tile", "arange", "range", "repeat"}
PLACING = ast.Pow | ast.LShift | ast.RShift | ast.BitAnd | ast.FloorDiv | ast.Mod
# Loops over a few: neighbours, corners, sides, passes.
TURNS = {"k", "corner", "turn", "step", "side"}


def tuned(path: Path) -> Iterator[str]:
    """Yield where each number that was chosen stands, and what it is."""
    name = path.relative_to(SOURCE).as_posix()
    free = NO_CHOICE.get(name, {})
    for top in ast.parse(path.read_text(encoding="utf-8")).body:
        for text in _of_statement(top):
            if text not in free and text.split(":")[0] not in free:
                yield f"{name}:{top.lineno}: {text}"


def _of_statement(top: ast.stmt) -> Iterator[str]:
    if isinstance(top, ast.Assign | ast.AnnAssign) and top.value is not None:
        target = top.targets[0] if isinstance(top, ast.Assign) else top.target
        pairs = [(target, top.value)]
        if isinstance(target, ast.Tuple) and isinstance(top.value, ast.Tuple):
            pairs = list(zip(target.elts, top.value.elts, strict=True))
        for one, value in pairs:
            yield from (f"{ast.unparse(one)}: {shown}" for shown in _named(value))
    elif isinstance(top, ast.FunctionDef | ast.ClassDef):
        yield from (f"{top.name}: {ast.unparse(node)}" for node in _chosen(top))


def _named(value: ast.expr) -> Iterator[str]:
    """Yield what counts of the value of a constant: a number once, of several each, of the derived the factors."""
    if isinstance(value, ast.Tuple):
        for part in value.elts:
            yield from _named(part)
    elif any(isinstance(node, ast.Name) and node.id.isupper() for node in ast.walk(value)):
        yield from (ast.unparse(node) for node in _chosen(value))
    elif any(_is_number(node) for node in ast.walk(value)) and not _is_enumeration(value):
        yield ast.unparse(value)


def _is_enumeration(value: ast.expr) -> bool:
    return isinstance(value, ast.Call) and ast.unparse(value.func) in ("range", "np.dtype")


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _chosen(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the numbers below a node that say neither where nor how many."""
    if isinstance(node, ast.Constant):
        if type(node.value) in (int, float) and node.value not in PLAIN and math.fabs(node.value) > 1e-6:
            yield node
    elif isinstance(node, ast.Call) and ast.unparse(node.func) == "_field":
        yield node.args[0]  # a setting: its default; the others are its range
    else:
        for field, value in ast.iter_fields(node):
            children = value if isinstance(value, list) else [value]
            for child in children if not _says_where(node, field) else []:
                if isinstance(child, ast.AST):
                    yield from _chosen(child)


def _says_where(node: ast.AST, field: str) -> bool:
    """Tell whether a field of a node holds an index, a shape, a power, a shift, or compares a place among a few."""
    if isinstance(node, ast.Call):
        return field == "args" and ast.unparse(node.func).split(".")[-1] in SHAPES
    if isinstance(node, ast.keyword):
        return node.arg in ("axis", "minlength")
    if isinstance(node, ast.BinOp):
        return field == "right" and isinstance(node.op, PLACING)
    if isinstance(node, ast.Compare):
        return field == "comparators" and isinstance(node.left, ast.Name) and node.left.id in TURNS
    if isinstance(node, ast.Subscript):
        return field == "slice"
    return field in ("annotation", "returns", "decorator_list")


def all_tuned() -> list[str]:
    """Return where all such numbers stand."""
    paths = sorted({path for pattern in FILES for path in SOURCE.glob(pattern)})
    kept = [path for path in paths if path.relative_to(SOURCE).as_posix() not in ELSEWHERE]
    return [text for path in kept for text in tuned(path)]


def test_the_method_is_tuned_by_no_more_numbers_than_before() -> None:
    found = all_tuned()
    assert len(found) <= MOST, "\n".join(found)


if __name__ == "__main__":
    print("\n".join(all_tuned()))
    print(len(all_tuned()))
