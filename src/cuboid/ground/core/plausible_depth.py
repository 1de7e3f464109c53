"""Whether the median depth of a recording is plausible for its depth scale."""

from __future__ import annotations

# Plausible range of the median depth of a room or a table, metres; real recordings at hand have 0.44 to 2.2.
NEAREST_MEDIAN_M, FARTHEST_MEDIAN_M = 0.2, 8.0


def is_plausible(median_m: float) -> bool:
    """Return whether a room or a table can have this median depth."""
    return NEAREST_MEDIAN_M <= median_m <= FARTHEST_MEDIAN_M


def scale_warning(median_m: float, units: float) -> str | None:
    """Return a one-line warning with a likely depth scale if the median depth is not plausible, else None.

    Parameters
    ----------
    median_m : float
        Median depth, metres.
    units : float
        Depth units per metre in use.
    """
    if is_plausible(median_m):
        return None
    likely = units * (10 if median_m > FARTHEST_MEDIAN_M else 0.1)
    return (
        f"the depth scale of {units:g} units per metre is probably wrong: the median depth is {median_m:.2g} m; "
        f"at --depth-scale {likely:g} it is {median_m * units / likely:.2g} m"
    )
