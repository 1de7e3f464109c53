"""Evaluation of a whole store against ground truth: a row of figures per recording, computed by the workers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from distributed import Client

from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.schema import BOX_COLUMNS, DONE, OBJECTS, RUNS, SIGHTINGS
from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import InputError
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.ground.geometry.se3 import rotation_from_quat_wxyz
from cuboid.lab.evaluation import Result, evaluate, read_result
from cuboid.lab.evaluation.figures import figures
from cuboid.lab.evaluation.result import BoxRows, MapBoxes
from cuboid.lab.evaluation.truth import NAME as TRUTH

_BOX = ", ".join(BOX_COLUMNS)


@dataclass(frozen=True, slots=True)
class Judged:
    """The figures of a store.

    Attributes
    ----------
    rows : dict of str to dict
        Figures of `cuboid.lab.evaluation.figures` and the cost of the run, by recording.
    without_truth : tuple of str
        Recordings without ground truth.
    refused : dict of str to str
        Recordings that cannot be evaluated, with the reason.
    not_done : dict of str to str
        Recordings that failed, with the reason: they have no figures, which is worse than bad figures.
    """

    rows: dict[str, dict[str, Any]]
    without_truth: tuple[str, ...]
    refused: dict[str, str]
    not_done: dict[str, str]


def judge_store(
    client: Client, url: str, truths: Path, *, version: str | None = None, settings: str | None = None
) -> Judged:
    """Evaluate the newest run of each recording against its ground truth.

    Parameters
    ----------
    client : distributed.Client
    url : str
        URL of the store.
    truths : Path
        Folder that holds ``NAME/truth.json`` or ``NAME.json`` for a recording NAME.
    version, settings : str, optional
        Use only runs of this version, or with these settings.

    Raises
    ------
    InputError
        There is no store, no such version in it, or no ground truth for any recording.
    """
    runs = _runs(Tables(url), version, settings)
    done = [run for run in runs if run["state"] == DONE]
    found = {run["recording"]: truth_of(truths, run["recording"]) for run in done}
    if not any(found.values()):
        raise InputError(f"{truths}: has no NAME/truth.json or NAME.json of any recording of {url}")
    asked = [(run, truth) for run in done if (truth := found[run["recording"]]) is not None]
    answers = client.gather(client.map(_judge, asked, url=url, pure=False))
    pairs = [(run["recording"], answer) for (run, _), answer in zip(asked, answers, strict=True)]
    return Judged(
        rows={name: answer for name, answer in pairs if isinstance(answer, dict)},
        without_truth=tuple(name for name, truth in found.items() if truth is None),
        refused={name: answer for name, answer in pairs if isinstance(answer, str)},
        not_done={run["recording"]: run["reason"] for run in runs if run["state"] != DONE},
    )


def truth_of(truths: Path, recording: str) -> Path | None:
    """Return the ground-truth file of a recording, or None."""
    places = (truths / recording / TRUTH, truths / f"{recording}.json")
    return next((place for place in places if place.is_file()), None)


def _runs(tables: Tables, version: str | None, settings: str | None) -> list[dict[str, Any]]:
    """Return the newest run of each recording, by name."""
    where, values = ["true"], []
    for column, value in (("version", version), ("settings", settings)):
        if value is not None:
            where.append(f"{column} = ?")
            values.append(value)
    runs = tables.rows(
        "select run, recording, state, reason, results, poses, frames_read, settings, skipped, stages, peak_memory_mb "
        f"from {RUNS} where {' and '.join(where)} "
        "qualify row_number() over (partition by source order by finished desc, run) = 1 order by recording",
        values,
    )
    if not runs:
        versions = [row["version"] for row in tables.rows(f"select distinct version from {RUNS} order by version")]
        raise InputError(f"{tables.url}: has no runs of version '{version}'; there are {', '.join(versions)}")
    return runs


def _judge(asked: tuple[dict[str, Any], Path], url: str) -> dict[str, Any] | str:
    """Return the figures of a run, or the reason why it has none in one line; runs on a worker."""
    run, truth = asked
    place = StoreFolder(url)
    try:
        if run["results"] is not None and place.local is not None:
            result = read_result(place.local / run["results"])
        else:
            result = _from_tables(Tables(url), run)
        return figures(evaluate(result, truth)) | _costs(run)
    except InputError as error:
        return str(error)


def _costs(run: dict[str, Any]) -> dict[str, Any]:
    """Return the cost of a run."""
    stages = {stage["stage"]: stage for stage in run["stages"]}
    return {
        "ms_frame": stages["frame"]["median_ms"],
        "ms_frame_p95": stages["frame"]["p95_ms"],
        "ms_stages": {name: stage["median_ms"] for name, stage in stages.items() if name != "frame"},
        "memory_mb": run["peak_memory_mb"],
        "skipped": len(run["skipped"]),
    }


def _from_tables(tables: Tables, run: dict[str, Any]) -> Result:
    """Return the result of a run without result files, from the tables; it lacks the boxes of single frames."""
    if run["poses"] == "estimated":
        raise InputError(f"{run['recording']}: its poses were estimated, and without its files no one knows them")
    seen = tables.rows(
        f"select frame, label, {_BOX} from {SIGHTINGS} where run = ? order by frame, label", [run["run"]]
    )
    objects = tables.rows(f"select label, score, {_BOX} from {OBJECTS} where run = ? order by label", [run["run"]])
    read = np.arange(run["frames_read"]) * _every(run["settings"])
    return Result(
        path=Path(tables.url) / run["recording"],
        tracks=BoxRows(_ints(seen, "frame"), _ints(seen, "label"), _boxes(seen)),
        objects=MapBoxes(
            _ints(objects, "label"), _boxes(objects), np.array([row["score"] for row in objects], np.float64)
        ),
        frames=read[~np.isin(read, [item["frame"] for item in run["skipped"]])],
        skipped=len(run["skipped"]),
        poses=run["poses"],
    )


def _every(settings: str) -> int:
    return int(msgspec.json.decode(settings).get("every", 1))


def _ints(rows: Sequence[dict[str, Any]], name: str) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.array([row[name] for row in rows], np.int64)


def _boxes(rows: Sequence[dict[str, Any]]) -> Float64Array:
    return pack([_box(np.array([row[name] for name in BOX_COLUMNS], np.float64)) for row in rows])


def _box(numbers: Float64Array) -> Box:
    """Return the box of the columns of a row (10,), its quaternion normalised: the tables have only seven digits."""
    quaternion = numbers[6:] / np.linalg.norm(numbers[6:])
    return Box(numbers[:3], numbers[3:6], rotation_from_quat_wxyz(quaternion.tolist()))
