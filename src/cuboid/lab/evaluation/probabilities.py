"""The probability of each sighting of a result: that in `tracks.csv`, else that of its label in `objects.json`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.values import Fraction, FrameNumber, Label
from cuboid.ground.formats.folder import TRACKS
from cuboid.ground.formats.table_validation import Row, column_names, read_table
from cuboid.results.files import Results

COLUMN = "probability"


class ProbabilityEntry(Row, frozen=True):
    """The probability of a sighting; other columns are ignored."""

    frame: FrameNumber
    label: Label
    probability: Fraction | None


def read_probabilities(path: Path, frame: npt.NDArray[np.int64], label: npt.NDArray[np.int64]) -> Float64Array:
    """Return the probability of each sighting, (N,); NaN where there is none.

    Parameters
    ----------
    path : Path
        A result folder, whose `objects.json` has the probability of labels, or the CSV of another tracker.
    frame, label : (N,) int64
        The sightings.

    Raises
    ------
    InputError
        A file is malformed; the message names file and line.
    """
    table = path / TRACKS if path.is_dir() else path
    has_column = COLUMN in column_names(table)
    rows = read_table(table, ProbabilityEntry, any_order=True) if has_column else ()
    of_row = {(row.frame, row.label): row.probability for _, row in rows}
    values = [of_row.get(key) for key in zip(frame.tolist(), label.tolist(), strict=True)]
    if path.is_dir() and None in values:
        of_label = {name: item.probability for name, item in Results(path).survivor.items()}
        values = [of_label.get(k) if one is None else one for k, one in zip(label.tolist(), values, strict=True)]
    return np.array(values, np.float64)


def of_labels(label: npt.NDArray[np.int64], probability: Float64Array) -> dict[int, float]:
    """Return the probability of each label at its last sighting; the sightings (N,) are in frame order."""
    known = ~np.isnan(probability)
    return dict(zip(label[known].tolist(), probability[known].tolist(), strict=True))
