"""The fitted score of a region: boosted trees over its quantities, from a file that comes with the program."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cuboid.method.proposals.kernels.quantities import QUANTITIES

FILE = "regions.npz"


class Forest(NamedTuple):
    """Boosted trees: the log-odds are the sum of one leaf of each tree.

    Attributes
    ----------
    base : float
        Added to the sum.
    roots : (T,) int32
        First node of each tree.
    quantity : (N,) int16
        Column of the compared quantity; -1 for a leaf.
    value : (N,) float32
        Largest value that goes to `smaller`; log-odds of a leaf.
    smaller, larger : (N,) int32
        Next nodes.
    least : (S,) float32
        Smallest sums of the first trees, after each stage, of regions that are probable enough to be chosen: nearly all
        such regions of the pictures of the fit have larger ones.
    """

    base: float
    roots: npt.NDArray[np.int32]
    quantity: npt.NDArray[np.int16]
    value: npt.NDArray[np.float32]
    smaller: npt.NDArray[np.int32]
    larger: npt.NDArray[np.int32]
    least: npt.NDArray[np.float32]


@cache
def fitted_forest() -> Forest:
    """Return the fitted trees of the package."""
    with resources.files(__package__).joinpath(FILE).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        if tuple(arrays["quantities"].tolist()) != QUANTITIES:
            raise ValueError(f"{FILE} was fitted to other quantities")
        return Forest(float(arrays["base"]), *(arrays[name] for name in Forest._fields[1:]))
