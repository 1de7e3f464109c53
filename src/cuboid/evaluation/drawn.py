"""A result against keyframes: recall, precision, labels over time, and at which stage things are lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.errors import InputError
from cuboid.evaluation.clear import clear
from cuboid.evaluation.funnel import NO_RECTS, Finished, Rects, Stage, early_stages, rects_by_frame
from cuboid.evaluation.keyframes import DrawnObject, Keyframe, Keyframes, read_keyframes
from cuboid.evaluation.matching import FrameOverlap, ratio
from cuboid.evaluation.rectangles import FrameJudgement, Outcome, judge_frame
from cuboid.evaluation.result import RectRows, read_rects
from cuboid.outputs import RunReport, read_run
from cuboid.outputs.folder import RUN, TRACKS
from cuboid.outputs.text import LENGTH, rounded
from cuboid.readers.recording import Recording

FORMAT, VERSION = "cuboid-keyframes-evaluation", 1
THRESHOLDS = (0.5, 0.25)


@dataclass(frozen=True, slots=True)
class ScoresAt:
    """What the labelled sightings are worth at one IoU.

    Attributes
    ----------
    threshold : float
    recall, precision : float or None
        found / rectangles; found / (found + false). None where there is nothing to divide by.
    rectangles, found : int
        Drawn ones that count, and those of them that are found.
    false : int
        Sightings that pair with nothing drawn.
    neither : mapping of str to int
        Sightings that count neither way, by why.
    objects, objects_found : int
        Objects that have a rectangle that counts; those that are found in one frame or more.
    one_label : float or None
        Of the pairs of objects that were found more than once, the share with the object's most frequent label.
    idf1 : float or None
        Under the best one-to-one pairing of objects with labels.
    """

    threshold: float
    recall: float | None
    precision: float | None
    rectangles: int
    found: int
    false: int
    neither: Mapping[str, int]
    objects: int
    objects_found: int
    one_label: float | None
    idf1: float | None


@dataclass(frozen=True, slots=True)
class RecallAt:
    """How many of the drawn rectangles a stage has."""

    threshold: float
    found: int
    recall: float | None


@dataclass(frozen=True, slots=True)
class StageRecall:
    """What of the drawn rectangles a stage of the method has.

    Attributes
    ----------
    name : str
    per_frame : float or None
        Rectangles a judged frame.
    at : tuple of RecallAt
        Empty where they cannot be had.
    reason : str
        Why not.
    """

    name: str
    per_frame: float | None
    at: tuple[RecallAt, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class DrawnOutcome:
    """What became of one object, at IoU 0.5.

    Attributes
    ----------
    id : int
    name : str
    group : bool
    rectangles : int
        Drawn ones that count.
    found : tuple of int or None
        How many of them each stage has, in the order of the funnel; None where it cannot be had.
    labels : tuple of int
        Of the sightings that found it, in the order in which they came.
    """

    id: int
    name: str
    group: bool
    rectangles: int
    found: tuple[int | None, ...]
    labels: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class JudgedFrame:
    """A frame with what was drawn and found in it, for pictures and figures.

    Attributes
    ----------
    keyframe : Keyframe
    rects : RectRows
        Its labelled sightings.
    at : tuple of FrameJudgement
        One a threshold.
    """

    keyframe: Keyframe
    rects: RectRows
    at: tuple[FrameJudgement, ...]


@dataclass(frozen=True, slots=True)
class KeyframeEvaluation:
    """All that `evaluate_keyframes` finds.

    Attributes
    ----------
    result, keyframes : str
        What was compared.
    frames : tuple of JudgedFrame
    not_given, skipped : tuple of int
        Keyframes that the run was not given (`--every`, `--limit`), which are not judged; and those that it was
        given and could not use, which are: what they show is missed.
    at : tuple of ScoresAt
    funnel : tuple of StageRecall
        The last stage is that of the labelled sightings.
    objects : tuple of DrawnOutcome
    recording : Recording or None
        Opened again.
    no_recording : str
        Why there is none.
    """

    result: str
    keyframes: str
    frames: tuple[JudgedFrame, ...]
    not_given: tuple[int, ...]
    skipped: tuple[int, ...]
    at: tuple[ScoresAt, ...]
    funnel: tuple[StageRecall, ...]
    objects: tuple[DrawnOutcome, ...]
    recording: Recording | None = None
    no_recording: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON: numbers have six decimals, what is undefined is None."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "result": self.result,
            "keyframes": self.keyframes,
            "frames_judged": len(self.frames),
            "frames_not_given": list(self.not_given),
            "frames_skipped": list(self.skipped),
            "at": [_plain(asdict(at)) for at in self.at],
            "funnel": [_plain(asdict(stage)) for stage in self.funnel],
            "objects": [_plain(asdict(item)) for item in self.objects],
            "frames": [_frame_to_dict(frame) for frame in self.frames],
        }


def evaluate_keyframes(
    result: Path | str, keyframes: Keyframes | Path | str, recording: Path | None = None
) -> KeyframeEvaluation:
    """Judge a result by rectangles that a person drew.

    Parameters
    ----------
    result : path
        A result folder, or a CSV with the rectangles of any other tracker.
    keyframes : Keyframes or path
    recording : Path, optional
        Where the recording lies now, from which the 2D proposals are computed again; unless given, where it lay.

    Raises
    ------
    InputError
        A file cannot be used, or result and keyframes are of different recordings.
    """
    result = Path(result)
    truth = keyframes if isinstance(keyframes, Keyframes) else read_keyframes(Path(keyframes))
    folder = result.is_dir()
    report = read_run(result / RUN) if folder else None
    judged, not_given, skipped = _choose(truth, result, report)
    rows = read_rects(result / TRACKS if folder else result, unique=True)
    used = [item.frame for item in judged if item.frame not in skipped]
    stages = [Stage("labelled sightings", rects_by_frame(rows))]
    run = None if report is None else Finished.open(result, report, recording)
    if run is not None:
        stages = [*early_stages(run, used), *stages]
    frames = tuple(_judged(item, rows) for item in judged)
    by_stage = [_found_by(stage.rects_xyxy, judged) for stage in stages]
    return KeyframeEvaluation(
        result=str(result),
        keyframes=str(truth.path),
        frames=frames,
        not_given=not_given,
        skipped=skipped,
        at=tuple(_scores(frames, k) for k in range(len(THRESHOLDS))),
        funnel=tuple(_recall(stage, found, judged) for stage, found in zip(stages, by_stage, strict=True)),
        objects=_objects(truth.objects, frames, by_stage),
        recording=None if run is None else run.recording,
        no_recording=f"{result} names none" if run is None else run.reason,
    )


def _choose(
    truth: Keyframes, result: Path, report: RunReport | None
) -> tuple[list[Keyframe], tuple[int, ...], tuple[int, ...]]:
    """Return the keyframes to judge, those that the run was not given, and those of the judged that it skipped."""
    if not truth.frames:
        raise InputError(f"{truth.path}: has no frames")
    if report is None:
        return list(truth.frames), (), ()
    every, limit = int(report.config.get("every", 1)), report.config.get("limit")
    end = report.frames_read * every
    last = truth.frames[-1].frame
    if report.complete and limit is None and last >= end:
        raise InputError(
            f"{truth.path}: has frame {last}, but {result} is of a recording of at most {end} frames; "
            "'frame' counts from 0 in the recording's order, whatever its files are called"
        )
    given = [item for item in truth.frames if item.frame < end and item.frame % every == 0]
    not_given = tuple(item.frame for item in truth.frames if item not in given)
    if not given:
        raise InputError(
            f"{result}: the run was given none of the frames of {truth.path} "
            f"(one in {every} of the first {end}); there is nothing to judge"
        )
    bad = {frame for frame, _ in report.skipped}
    return given, not_given, tuple(item.frame for item in given if item.frame in bad)


def _judged(keyframe: Keyframe, rows: RectRows) -> JudgedFrame:
    here = rows.frame == keyframe.frame
    rects = RectRows(rows.frame[here], rows.label[here], rows.rects_xyxy[here])
    return JudgedFrame(keyframe, rects, tuple(judge_frame(keyframe, rects.rects_xyxy, t) for t in THRESHOLDS))


def _scores(frames: Sequence[JudgedFrame], k: int) -> ScoresAt:
    at = [frame.at[k] for frame in frames]
    outcomes = Counter(outcome for one in at for outcome in one.outcomes)
    found, false = sum(int(one.found.sum()) for one in at), outcomes[Outcome.FALSE]
    rectangles = sum(int(one.counts.sum()) for one in at)
    labels = _labels(frames, k)
    again = [had for had in labels.values() if len(had) > 1]
    aside = (Outcome.IGNORED, Outcome.HARDLY_VISIBLE, Outcome.IN_GROUP)
    return ScoresAt(
        threshold=THRESHOLDS[k],
        recall=ratio(found, rectangles),
        precision=ratio(found, found + false),
        rectangles=rectangles,
        found=found,
        false=false,
        neither={why.value: outcomes[why] for why in aside},
        objects=len(labels),
        objects_found=sum(len(had) > 0 for had in labels.values()),
        one_label=ratio(sum(max(Counter(had).values()) for had in again), sum(map(len, again))),
        idf1=_idf1(frames, k),
    )


def _labels(frames: Sequence[JudgedFrame], k: int) -> dict[int, list[int]]:
    """Return for each object with a rectangle that counts the labels with which it was found, frame by frame."""
    labels: dict[int, list[int]] = {}
    for frame in frames:
        at = frame.at[k]
        for i, drawn in enumerate(frame.keyframe.drawn):
            if at.counts[i]:
                had = labels.setdefault(drawn.id, [])
                if at.partner[i] >= 0:
                    had.append(int(frame.rects.label[at.partner[i]]))
    return labels


def _idf1(frames: Sequence[JudgedFrame], k: int) -> float | None:
    """Return IDF1 of what counts: rectangles of which enough is visible, sightings that are true or false."""
    ids = {name: i for i, name in enumerate(sorted({one.id for frame in frames for one in frame.keyframe.drawn}))}
    names = {name: i for i, name in enumerate(sorted({int(n) for frame in frames for n in frame.rects.label}))}
    overlaps = []
    for frame in frames:
        at = frame.at[k]
        judged = [n for n, outcome in enumerate(at.outcomes) if outcome in (Outcome.TRUE, Outcome.FALSE)]
        thing = np.array([ids[one.id] for one in frame.keyframe.drawn], np.int64)[at.counts]
        label = np.array([names[int(frame.rects.label[n])] for n in judged], np.int64)
        overlaps.append(FrameOverlap(frame.keyframe.frame, thing, label, at.iou[at.counts][:, judged]))
    return clear(overlaps, [[] for _ in overlaps], THRESHOLDS[k]).idf1


def _found_by(rects: Rects | None, judged: Sequence[Keyframe]) -> list[list[FrameJudgement]] | None:
    """Return a stage's judgements: for each threshold those of all frames."""
    if rects is None:
        return None
    return [[judge_frame(item, rects.get(item.frame, NO_RECTS), t) for item in judged] for t in THRESHOLDS]


def _recall(stage: Stage, found: list[list[FrameJudgement]] | None, judged: Sequence[Keyframe]) -> StageRecall:
    if found is None or stage.rects_xyxy is None:
        return StageRecall(stage.name, None, (), stage.reason)
    have = sum(len(stage.rects_xyxy.get(item.frame, NO_RECTS)) for item in judged)
    at = []
    for threshold, frames in zip(THRESHOLDS, found, strict=True):
        hits = sum(int(one.found.sum()) for one in frames)
        at.append(RecallAt(threshold, hits, ratio(hits, sum(int(one.counts.sum()) for one in frames))))
    return StageRecall(stage.name, ratio(have, len(judged)), tuple(at), "")


def _objects(
    objects: Sequence[DrawnObject], frames: Sequence[JudgedFrame], by_stage: Sequence[list[list[FrameJudgement]] | None]
) -> tuple[DrawnOutcome, ...]:
    labels = _labels(frames, 0)

    def hits(name: int, stage: list[list[FrameJudgement]] | None) -> int | None:
        if stage is None:
            return None
        return sum(
            int(at.found[i])
            for frame, at in zip(frames, stage[0], strict=True)
            for i, drawn in enumerate(frame.keyframe.drawn)
            if drawn.id == name
        )

    def count(name: int) -> int:
        return sum(
            int(frame.at[0].counts[i])
            for frame in frames
            for i, drawn in enumerate(frame.keyframe.drawn)
            if drawn.id == name
        )

    return tuple(
        DrawnOutcome(
            item.id,
            item.name,
            item.group,
            count(item.id),
            tuple(hits(item.id, stage) for stage in by_stage),
            tuple(dict.fromkeys(labels[item.id])),
        )
        for item in objects
        if item.id in labels
    )


def _frame_to_dict(frame: JudgedFrame) -> dict[str, Any]:
    """Return what was found in a frame at the first threshold."""
    at = frame.at[0]
    return {
        "frame": frame.keyframe.frame,
        "drawn": [
            {
                "id": drawn.id,
                "counts": bool(at.counts[i]),
                "label": int(frame.rects.label[at.partner[i]]) if at.partner[i] >= 0 else None,
                "best_iou": rounded(at.iou[i].max(initial=0.0), LENGTH),
            }
            for i, drawn in enumerate(frame.keyframe.drawn)
        ],
        "sightings": [
            {"label": int(label), "outcome": outcome.value}
            for label, outcome in zip(frame.rects.label, at.outcomes, strict=True)
        ],
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return rounded(value, LENGTH) if isinstance(value, float) else value
