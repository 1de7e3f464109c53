"""`cuboid evaluate` against keyframes: its tables and pictures."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rich.table import Table

from cuboid.cli.results import give
from cuboid.cli.tables import console, new_table, score
from cuboid.ground.core.errors import InputError, counted

if TYPE_CHECKING:
    from cuboid.lab.evaluation.evaluate_keyframes import KeyframeEvaluation
    from cuboid.lab.evaluation.names import NameQuality
    from cuboid.lab.evaluation.reliability import Reliability

# Number of frames of a list that are named.
FRAMES_NAMED = 8


def run(args: argparse.Namespace) -> int:
    """Evaluate, draw and print."""
    from cuboid.lab.evaluation.evaluate_keyframes import evaluate_keyframes

    for name in ("cloud", "trajectory"):
        if getattr(args, name) is not None:
            raise InputError(f"--{name} cannot be used with keyframes: {args.truth}")
    found = evaluate_keyframes(args.result, args.truth, args.recording)
    drawn = 0 if args.pictures is None else _draw(args, found)
    named = _name(args, found) if args.give_names else {}

    def show() -> None:
        print_evaluation(found)
        if args.pictures is not None:
            console().print(f"{counted(drawn, 'picture')} in {args.pictures}")
        if args.give_names:
            console().print(f"{counted(len(named), 'object')} named in {args.result}")

    give(args, found.to_dict(), show)
    return 0


def _name(args: argparse.Namespace, found: KeyframeEvaluation) -> dict[int, str]:
    """Give the names of the drawn objects to the results; return them by label."""
    from cuboid.results.files import Results
    from cuboid.results.files.naming import name_object

    if not args.result.is_dir():
        raise InputError(f"{args.result}: only objects of results of 'cuboid track' can be named")
    survivor, names = Results(args.result).survivor, dict[int, str]()
    for label, name in found.names_by_label().items():
        item = survivor.get(label)
        if item is not None and name:
            names.setdefault(item.label, name)
    for label, name in names.items():
        name_object(args.result, label, name)
    return names


def _draw(args: argparse.Namespace, found: KeyframeEvaluation) -> int:
    """Write the pictures; return their number."""
    from cuboid.lab.evaluation.keyframe_pictures import write_pictures

    if isinstance(found.recording, str):
        raise InputError(f"{args.pictures}: pictures need the recording: {found.recording}")
    return write_pictures(args.pictures, found.frames, found.recording)


def print_evaluation(found: KeyframeEvaluation) -> None:
    """Print the evaluation as tables."""
    out = console()
    at = found.at[0]
    out.print(
        f"{found.result} against {found.keyframes}\n{counted(len(found.frames), 'keyframe')} judged, "
        f"{counted(at.rectangles, 'rectangle')} of {counted(at.objects, 'object')} to be found"
    )
    if found.not_given:
        out.print(f"not judged, since the run did not read them (--every, --limit): {_frames(found.not_given)}")
    if found.skipped:
        out.print(f"skipped by the run, so that all their rectangles count as missed: {_frames(found.skipped)}")
    out.print(_scores_table(found))
    print_reliability(at.reliability)
    if len(found.funnel) > 1:
        out.print(_funnel_table(found))
    for stage in found.funnel:
        if stage.reason:
            out.print(f"no {stage.name}: {stage.reason}")
    out.print(_objects_table(found))
    if found.names is not None:
        print_names(found.names)


def print_names(names: NameQuality) -> None:
    """Print the accuracy of the names from a detector, and the confused classes."""
    out = console()
    out.print(
        f"names: {names.right} of {names.judged} objects of known classes named correctly "
        f"(accuracy {score(names.accuracy)}, top 3 {score(names.top3)}), {names.named} named "
        f"(precision {score(names.precision)})"
    )
    if names.confusion:
        table = new_table("true class", "found as", "objects", left=2)
        for one in names.confusion:
            table.add_row(one.true_class, one.found_class or "-", str(one.count))
        out.print(table)


def print_reliability(found: Reliability) -> None:
    """Print how well the probability of labels agrees with the fraction of right ones; nothing without labels."""
    if found.labels == 0:
        return
    bins = [one for one in found.bins if one.labels]
    table = new_table("probability of labels", *(f"{one.low:.1f} to {one.high:.1f}" for one in bins))
    table.add_row("labels", *(str(one.labels) for one in bins))
    table.add_row("mean probability", *(score(one.mean_probability) for one in bins))
    table.add_row("fraction right", *(score(one.fraction_right) for one in bins))
    console().print(table)
    console().print(f"expected calibration error {score(found.expected_calibration_error)}")


def _frames(frames: tuple[int, ...]) -> str:
    more = f" and {len(frames) - FRAMES_NAMED} more" if len(frames) > FRAMES_NAMED else ""
    return f"{'frame' if len(frames) == 1 else 'frames'} {', '.join(map(str, frames[:FRAMES_NAMED]))}{more}"


def _scores_table(found: KeyframeEvaluation) -> Table:
    table = new_table(
        "labelled sightings",
        "recall",
        "precision",
        "found",
        "false",
        "ignored",
        "objects found",
        "one label",
        "IDF1",
        "AP",
    )
    for at in found.at:
        table.add_row(
            f"IoU {at.threshold:.2f}",
            score(at.recall),
            score(at.precision),
            f"{at.found} of {at.rectangles}",
            str(at.false),
            str(sum(at.neither.values())),
            f"{at.objects_found} of {at.objects}",
            score(at.one_label),
            score(at.idf1),
            score(at.ap),
        )
    return table


def _funnel_table(found: KeyframeEvaluation) -> Table:
    table = new_table(
        "stage where objects are lost", *(f"recall at {at.threshold:.2f}" for at in found.at), "per frame"
    )
    for stage in found.funnel:
        cells = [f"{score(at.recall)}  ({at.found})" for at in stage.at] or [""] * len(found.at)
        table.add_row(stage.name, *cells, "" if stage.per_frame is None else f"{stage.per_frame:.1f}")
    return table


def _objects_table(found: KeyframeEvaluation) -> Table:
    stages = [stage.short for stage in found.funnel]
    table = new_table("object", "id", "drawn", *stages, "labels")
    for item in found.objects:
        table.add_row(
            f"{item.name}{' (group)' if item.group else ''}",
            str(item.id),
            str(item.rectangles),
            *(str(item.stages.get(stage, "")) for stage in stages),
            ", ".join(map(str, item.labels)) or "none",
        )
    return table
