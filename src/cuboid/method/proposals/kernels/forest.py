"""The loop that evaluates boosted trees."""

from __future__ import annotations

from cuboid.ground.compiling.compiled import kernel

# A region is judged after each of so many trees: see `Forest.least`.
STAGE = 20
# Log-odds of a region that is left out.
LEFT_OUT_LOG_ODDS = -10.0


@kernel
def log_odds(found, usable, model, least, out):
    """Evaluate boosted trees: log-odds that each region is one whole thing.

    Parameters
    ----------
    found : (N, Q) float32
        Quantities.
    usable : (N,) uint8
        Regions with 0 are left out: log-odds of LEFT_OUT_LOG_ODDS.
    model : Forest
    least : (S,) float32
        A region is given up, with the sum so far, if the sum of the first (k + 1) * STAGE trees is below `least[k]`.
    out : (N,) float64, output
    """
    for i in range(len(found)):
        total, row = model.base, found[i]
        if not usable[i]:
            out[i] = LEFT_OUT_LOG_ODDS
            continue
        for t in range(len(model.roots)):
            k = t // STAGE - 1
            if t % STAGE == 0 and 0 <= k < len(least) and total < least[k]:
                break
            at = model.roots[t]
            while model.quantity[at] >= 0:
                # Nodes are stored with the branch for smaller values first.
                at = model.smaller[at] if row[model.quantity[at]] <= model.value[at] else model.larger[at]
            total += model.value[at]
        out[i] = total
