"""The recipes in the order in which the numbers of scenes choose them; frequent kinds of places appear twice."""

from __future__ import annotations

from collections.abc import Callable

from table_recipes import clutter, floor, hands, heap, plain_table, stacks
from wall_recipes import desk, kitchen, lying_cartons, shelf

from scene import Scene

RECIPES: tuple[Callable[[Scene], None], ...] = (
    clutter, desk, kitchen, stacks, shelf, heap, hands, lying_cartons, floor, plain_table, kitchen, clutter,
)  # fmt: skip
