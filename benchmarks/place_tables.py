"""The tables over places: the figures of a version, its means, and the differences of two versions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from cuboid.lab.evaluation.reliability import Reliability, ReliabilityBin, pooled
from place_figures import FIGURES
from place_list import STILLS
from tables import cell, markdown

Row = dict[str, Any]
# The figure by which a change is taken or refused: it falls with each object that is lost and each false label.
DECIDING = "f1"


def judged(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that have figures."""
    return [row for row in rows if "failed" not in row]


def mean_and_error(values: Sequence[float]) -> tuple[float, float] | None:
    """Return the mean and its standard error, which is NaN for one value; None without values."""
    if not values:
        return None
    error = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return float(np.mean(values)), float(error)


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [row[name] for row in rows if row.get(name) is not None]


def summary_table(rows: Sequence[Row]) -> str:
    """Return mean and worst figures of real places and of made kinds, and the means of the stills."""
    lines = []
    for name, part in (("real places", real(rows)), ("sets of stills", stills(rows)), ("made kinds", made(rows))):
        if part:
            lines.append([f"{name}, mean", str(len(part)), *_means(part, _mean_text)])
        if len(part) > 2:
            lines.append(["... the worst", "", *(worst(part, figure) for figure in FIGURES)])
    return markdown(["places", "number", *FIGURES.values()], lines)


def real(rows: Sequence[Row]) -> list[Row]:
    """Return the judged recordings of real places."""
    return [row for row in judged(rows) if not row["made"] and row["kind"] != STILLS]


def stills(rows: Sequence[Row]) -> list[Row]:
    """Return the judged sets of stills."""
    return [row for row in judged(rows) if row["kind"] == STILLS]


def made(rows: Sequence[Row]) -> list[Row]:
    """Return the judged kinds of made places."""
    return [row for row in judged(rows) if row["made"]]


def places_table(rows: Sequence[Row]) -> str:
    """Return a line for each place; of one that failed, the reason."""
    header = ["place", "kind", "IoU", "to find", "found", "false", *FIGURES.values()]
    lines = []
    for row in rows:
        head = [row["name"], row["kind"], f"{row['iou']:g}".lstrip("0")]
        if "failed" in row:
            reason = f"failed: {row['failed'].replace('|', '/')}"
            lines.append([*head, "-", "-", "-", reason, *[""] * (len(FIGURES) - 1)])
        else:
            lines.append([*head, *(str(row[name]) for name in ("wanted", "found", "false")), *_cells(row)])
    return markdown(header, lines)


def _cells(row: Row) -> list[str]:
    return [cell(row.get(name)) for name in FIGURES]


def groups(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Return the rows of each kind of place, of real and made places, and of all."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    found = [(kind, [row for row in rows if row["kind"] == kind]) for kind in kinds]
    found += [(name, [row for row in rows if row["made"] == made]) for name, made in (("real", False), ("made", True))]
    return [(name, part) for name, part in [*found, ("all", list(rows))] if part]


def means_table(rows: Sequence[Row]) -> str:
    """Return the means by kind, of real, made and all places with the standard error over places, and the worst."""
    rows = judged(rows)
    lines = [[name, str(len(part)), *_means(part, _mean_text)] for name, part in groups(rows)]
    lines.append(["worst place", "", *(worst(rows, name) for name in FIGURES)])
    return markdown(["places", "number", *FIGURES.values()], lines)


def _means(rows: Sequence[Row], text: Callable[[Sequence[float]], str]) -> list[str]:
    return [text(_values(rows, name)) for name in FIGURES]


def _mean_text(values: Sequence[float], sign: str = "") -> str:
    found = mean_and_error(values)
    if found is None:
        return "-"
    mean, error = found
    return f"{mean:{sign}.3f}" + ("" if np.isnan(error) else f" ± {error:.3f}")


def worst(rows: Sequence[Row], name: str) -> str:
    """Return the worst value of a figure, and the place that has it."""
    have = [row for row in rows if row.get(name) is not None]
    if not have:
        return "-"
    row = (max if name == "calibration" else min)(have, key=lambda row: row[name])
    return f"{row[name]:.3f} ({row['name']})"


def reliability_table(rows: Sequence[Row]) -> str:
    """Return how many labels of all places are right, by their probability."""
    parts = [row["reliability"] for row in judged(rows)]
    whole = pooled(
        Reliability(part["labels"], None, tuple(ReliabilityBin(**one) for one in part["bins"])) for part in parts
    )
    lines = [
        [f"{one.low:.1f} to {one.high:.1f}", one.labels, one.mean_probability, one.fraction_right] for one in whole.bins
    ]
    error = f"expected calibration error of {whole.labels} labels: {cell(whole.expected_calibration_error)}"
    return f"{markdown(['probability', 'labels', 'mean probability', 'fraction right'], lines)}\n\n{error}"


def differences(rows: Sequence[Row], before: Sequence[Row]) -> list[Row]:
    """Return this version minus the other, for each place that both judged by the same recordings."""
    others = {row["name"]: row for row in judged(before)}
    found = []
    for row in judged(rows):
        other = others.get(row["name"])
        if other is not None and other["parts"] == row["parts"]:
            both = {name: (row.get(name), other.get(name)) for name in FIGURES}
            changes = {name: None if None in pair else pair[0] - pair[1] for name, pair in both.items()}
            found.append({**{name: row[name] for name in ("name", "kind", "made")}, **changes})
    return found


def differences_table(changes: Sequence[Row]) -> str:
    """Return a line of differences for each place, and means with the standard error over places."""

    def signed(values: Sequence[float]) -> str:
        return _mean_text(values, "+")

    lines = [[row["name"], row["kind"], *_means([row], signed)] for row in changes]
    lines += [[f"mean: {name}", str(len(part)), *_means(part, signed)] for name, part in groups(changes)]
    return markdown(["place", "kind", *FIGURES.values()], lines)


def verdict(changes: Sequence[Row], left_out: Collection[str]) -> str:
    """Return in one line whether the change is taken.

    It is taken if the mean difference of F1 over places is more than its standard error, and no kind falls by more than
    its noise: the standard deviation of the differences over all places, divided by the root of the kind's number of
    places. Kinds (or places) left out do not count in the mean; their fall is still named.
    """
    counting = [row for row in changes if not {row["kind"], row["name"]} & set(left_out)]
    found = mean_and_error(_values(counting, DECIDING))
    if found is None or np.isnan(found[1]):
        return "verdict: none, since fewer than two places can be compared"
    mean, error = found
    falling = _falling_kinds(changes)
    taken = mean > error and not falling
    rises = "rises" if mean >= 0 else "falls"
    size = "beyond" if abs(mean) > error else "not beyond"
    without = f", without {', '.join(left_out)}" if left_out else ""
    return (
        f"verdict: mean {FIGURES[DECIDING]} over {len(_values(counting, DECIDING))} places{without} {rises} by "
        f"{abs(mean):.4f}, standard error {error:.4f}: {'taken' if taken else 'not taken'}, {size} the noise; "
        f"kinds that fall: {', '.join(falling) or 'none'}"
    )


def _falling_kinds(changes: Sequence[Row]) -> list[str]:
    """Return the kinds of places whose mean falls by more than their noise, with the fall."""
    spread = float(np.std(_values(changes, DECIDING), ddof=1))
    falling = []
    for kind in dict.fromkeys(row["kind"] for row in changes):
        values = _values([row for row in changes if row["kind"] == kind], DECIDING)
        if values and np.mean(values) < -spread / np.sqrt(len(values)):
            falling.append(f"{kind} ({np.mean(values):+.3f})")
    return falling
