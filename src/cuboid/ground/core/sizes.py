"""Sizes of boxes as text, rounded to whole centimetres where half the 95 % interval is 1 cm or more."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from cuboid.ground.arrays import Float64Array

# Half the 95 % interval of a normal distribution, standard deviations.
SIGMAS_95 = 1.96
# If half the 95 % interval of a size is at least this wide, metres, the size has no decimal place of a centimetre.
COARSE_M = 0.01
# Smallest half interval that is printed, metres: that of the last printed digit.
MIN_INTERVAL_M = 0.001
# From this half interval of a level side on, metres, a side that no camera saw is worth a word.
GUESSED_M = 0.05
AROUND = ("+x", "-x", "+y", "-y")


def size_text(
    size_m: Float64Array | Sequence[float],
    sigma_m: Sequence[float] | None = None,
    *,
    errors: bool = False,
    separator: str = " x ",
) -> str:
    """Return length, width and height as text, centimetres.

    Parameters
    ----------
    size_m : (3,)
    sigma_m : (3,), optional
        Their standard deviations, metres; empty or None if they are not known.
    errors : bool
        Whether each size is followed by half its 95 % interval, if that is known.
    separator : str
        Text between the sizes.
    """
    if not sigma_m:
        return separator.join(f"{100 * side:.1f}" for side in size_m)
    parts = []
    for side, sigma in zip(size_m, sigma_m, strict=True):
        within = max(SIGMAS_95 * sigma, MIN_INTERVAL_M)
        digits = 0 if within >= COARSE_M else 1
        parts.append(f"{100 * side:.{digits}f}" + (f" ± {100 * within:.{digits}f}" if errors else ""))
    return separator.join(parts)


def unseen_text(sides_seen: Collection[str], sigma_m: Sequence[float] | None) -> str:
    """Return "back not seen" if length or width is a guess for lack of a view; else an empty text."""
    unseen = sigma_m and any(side not in sides_seen for side in AROUND)
    return "back not seen" if unseen and sigma_m and SIGMAS_95 * max(sigma_m[:2]) >= GUESSED_M else ""
