"""The loop that evaluates boosted trees."""

from __future__ import annotations

from cuboid.ground.compiling.compiled import kernel

# A region whose sum of the first trees is below this log-odds is given up: the other trees add less than the rest of
# the way to a probability that could be chosen.
HOPELESS, FIRST_TREES = -4.0, 60


@kernel
def log_odds(found, usable, model, out):
    """Evaluate boosted trees: log-odds that each region is one whole thing.

    Parameters
    ----------
    found : (N, Q) float32
        Quantities.
    usable : (N,) uint8
        Regions with 0 are left out: log-odds of HOPELESS.
    model : Forest
    out : (N,) float64, output
    """
    for i in range(len(found)):
        total, row = model.base, found[i]
        if not usable[i]:
            total = HOPELESS
        else:
            for t in range(len(model.roots)):
                if t == FIRST_TREES and total < HOPELESS:
                    break
                at = model.roots[t]
                while model.quantity[at] >= 0:
                    # Nodes are stored with the branch for smaller values first.
                    at = model.smaller[at] if row[model.quantity[at]] <= model.value[at] else model.larger[at]
                total += model.value[at]
        out[i] = total
