"""Evaluation against keyframes: which annotated objects were found, and at which stage the others are lost."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.formats.folder import TRACKS
from cuboid.inputs.readers.recording import Recording
from cuboid.lab.evaluation.funnel import Stage, early_stages, open_again, rects_by_frame
from cuboid.lab.evaluation.keyframe_scores import (
    THRESHOLDS,
    DrawnOutcome,
    JudgedFrame,
    ScoresAt,
    StageRecall,
    judge,
    outcomes_of,
    scores_at,
)
from cuboid.lab.evaluation.keyframes import COUNTING, Keyframe, Keyframes, check_frames, read_keyframes
from cuboid.lab.evaluation.names import NameQuality, name_quality
from cuboid.lab.evaluation.probabilities import of_labels, read_probabilities
from cuboid.lab.evaluation.result import read_rects
from cuboid.results.files import Results, RunReport
from cuboid.results.files.text import LENGTH, plain, rounded

FORMAT, VERSION = "cuboid-keyframes-evaluation", 1


@dataclass(frozen=True, slots=True)
class KeyframeEvaluation:
    """All results of `evaluate_keyframes`.

    Attributes
    ----------
    result, keyframes : str
        Paths of the compared files.
    frames : tuple of JudgedFrame
    not_given, skipped : tuple of int
        Keyframes that the run did not get (`--every`, `--limit`), which are not judged; and keyframes that it got but
        could not use, which are judged: their objects count as missed.
    at : tuple of ScoresAt
    funnel : tuple of StageRecall
        Recall of each stage, in processing order; the last stage is the labelled sightings.
    objects : tuple of DrawnOutcome
    recording : Recording or str
        The reopened recording, or the reason why there is none.
    names : NameQuality or None
        None if no detector named objects.
    """

    result: str
    keyframes: str
    frames: tuple[JudgedFrame, ...]
    not_given: tuple[int, ...]
    skipped: tuple[int, ...]
    at: tuple[ScoresAt, ...]
    funnel: tuple[StageRecall, ...]
    objects: tuple[DrawnOutcome, ...]
    recording: Recording | str
    names: NameQuality | None = None

    def names_by_label(self) -> dict[int, str]:
        """Return the name of the drawn object that each label found; first labels of objects come before later ones."""
        found: dict[int, str] = {}
        for first in (True, False):
            for item in self.objects:
                for label in item.labels[:1] if first else item.labels[1:]:
                    found.setdefault(label, item.name)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON: numbers have six decimals, undefined values are None."""
        document: dict[str, Any] = plain(
            {
                "result": self.result,
                "keyframes": self.keyframes,
                "frames_judged": len(self.frames),
                "frames_not_given": list(self.not_given),
                "frames_skipped": list(self.skipped),
                "at": [asdict(at) for at in self.at],
                "funnel": [asdict(stage) for stage in self.funnel],
                "objects": [asdict(item) for item in self.objects],
                "frames": [_frame_to_dict(frame) for frame in self.frames],
                **({} if self.names is None else {"names": asdict(self.names)}),
            }
        )
        return {"format": FORMAT, "version": VERSION, **document}


def evaluate_keyframes(
    result: PathLike, keyframes: Keyframes | PathLike, recording: PathLike | None = None
) -> KeyframeEvaluation:
    """Evaluate a result against rectangles that a person drew.

    Parameters
    ----------
    result : path
        A result folder, or a CSV with the rectangles of any other tracker.
    keyframes : Keyframes or path
    recording : path, optional
        Present path of the recording, from which the 2D proposals are computed again; default: its path in the result.

    Raises
    ------
    InputError
        A file cannot be used, or result and keyframes are of different recordings.
    """
    result = as_path(result)
    truth = keyframes if isinstance(keyframes, Keyframes) else read_keyframes(keyframes)
    run = Results(result, recording) if result.is_dir() else None
    report = None if run is None else run.report
    judged, not_given = _given(truth, result, report)
    bad = set() if report is None else {frame for frame, _ in report.skipped}
    skipped = tuple(item.frame for item in judged if item.frame in bad)
    sightings = read_rects(result if run is None else result / TRACKS)
    stages = [Stage("labelled sightings", "labelled", rects_by_frame(sightings))]
    opened: Recording | str = f"{result} names none"
    if run is not None:
        opened = open_again(run)
        if isinstance(opened, Recording):
            check_frames(truth, opened)
        stages = [*early_stages(run, opened, [item.frame for item in judged if item.frame not in skipped]), *stages]
    probability = read_probabilities(result, sightings.frame, sightings.label)
    frames, funnel = judge(judged, sightings, probability, stages)
    label_probability = of_labels(sightings.label, probability)
    objects = outcomes_of(truth.objects, frames)
    return KeyframeEvaluation(
        result=str(result),
        keyframes=str(truth.path),
        frames=frames,
        not_given=not_given,
        skipped=skipped,
        at=tuple(scores_at(frames, k, label_probability) for k in range(len(THRESHOLDS))),
        funnel=funnel,
        objects=objects,
        recording=opened,
        names=name_quality(result, [(item.id, item.name, next(iter(item.labels), None)) for item in objects]),
    )


def _given(truth: Keyframes, result: Path, report: RunReport | None) -> tuple[list[Keyframe], tuple[int, ...]]:
    """Return the keyframes that the run got, and the numbers of those that it did not get."""
    if not truth.frames:
        raise InputError(f"{truth.path}: has no frames")
    if report is None:
        return list(truth.frames), ()
    every, last = int(report.config.get("every", 1)), truth.frames[-1].frame
    end = report.frames_read * every
    if report.complete and report.config.get("limit") is None and last >= end:
        raise InputError(
            f"{truth.path}: has frame {last}, but {result} is of a recording of at most {end} frames; {COUNTING}"
        )
    given = [item for item in truth.frames if item.frame < end and item.frame % every == 0]
    if not given:
        raise InputError(
            f"{result}: the run was given none of the frames of {truth.path}: "
            f"it had {'each' if every == 1 else f'one in {every}'} of the first {end}"
        )
    return given, tuple(item.frame for item in truth.frames if item not in given)


def _frame_to_dict(frame: JudgedFrame) -> dict[str, Any]:
    """Return the outcome of a frame at the first threshold."""
    at, label = frame.at[0], frame.sightings.label
    return {
        "frame": frame.keyframe.frame,
        "drawn": [
            {
                "id": drawn.id,
                "counts": bool(at.counts[i]),
                "label": int(label[at.partner[i]]) if at.partner[i] >= 0 else None,
                "best_iou": rounded(at.iou[i].max(initial=0.0), LENGTH),
                "stages": [short for short, found in frame.stages.items() if found[i]],
            }
            for i, drawn in enumerate(frame.keyframe.drawn)
        ],
        "sightings": [
            {"label": int(name), "outcome": outcome.value} for name, outcome in zip(label, at.outcomes, strict=True)
        ],
    }
