"""`cuboid evaluate`: compare a result with the truth."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console, new_table, score
from cuboid.ground.core.errors import InputError

if TYPE_CHECKING:
    from cuboid.lab.evaluation import Evaluation
    from cuboid.lab.evaluation.evaluate import Identity
    from cuboid.lab.evaluation.events import EventQuality
    from cuboid.lab.evaluation.points import HeatQuality
    from cuboid.lab.evaluation.relations import RelationsAt
    from cuboid.lab.evaluation.visits import VisitsQuality

EXAMPLE = "cuboid evaluate DIR truth.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    from cuboid.cli.evaluate_store import add_store

    parser.add_argument(
        "result",
        type=Path,
        nargs="?",
        metavar="RESULT",
        help="results of 'cuboid track', or a CSV file with the boxes of another tracker",
    )
    parser.add_argument(
        "truth",
        type=Path,
        nargs="?",
        metavar="TRUTH",
        help="a truth file, the folder of a recording of 'cuboid synth', keyframes with rectangles drawn by a person, "
        "or, if RESULT is a scene, the folder of made visits",
    )
    parser.add_argument(
        "--cloud", type=Path, metavar="PLY", help="a labelled point cloud to compare the heat of the map with"
    )
    parser.add_argument(
        "--trajectory",
        type=Path,
        metavar="FILE",
        help="true camera poses, which align the result with the world of the truth "
        "(default: true_trajectory.txt beside TRUTH, if the poses of the result were estimated)",
    )
    drawn = parser.add_argument_group("against keyframes")
    drawn.add_argument("--recording", type=Path, metavar="PATH", help="the recording, if it has moved since the run")
    drawn.add_argument(
        "--pictures",
        type=Path,
        metavar="DIR",
        help="draw each keyframe with its found, missed and false rectangles into DIR",
    )
    drawn.add_argument(
        "--give-names",
        action="store_true",
        help="give the names of the drawn objects to the objects that they are, in RESULT",
    )
    add_store(parser)
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Evaluate and print."""
    from cuboid.lab.evaluation import evaluate
    from cuboid.lab.evaluation.keyframes import is_keyframes

    if args.store is not None or args.truths is not None:
        if args.store is None or args.truths is None or args.result is not None:
            raise InputError("to evaluate a store, give --store STORE --truth DIR, without RESULT and TRUTH")
        from cuboid.cli.evaluate_store import run as judge_store

        return judge_store(args)
    if args.result is None or args.truth is None:
        raise InputError("expected RESULT and TRUTH, or --store STORE --truth DIR")
    if is_keyframes(args.truth):
        from cuboid.cli.keyframes import run as judge_keyframes

        return judge_keyframes(args)
    from cuboid.lab.evaluation.visits import evaluate_visits, is_visits

    if is_visits(args.truth):
        visits = evaluate_visits(args.result, args.truth)
        give(args, visits.to_dict(), lambda: print_visits(visits))
        return 0
    for option in ("--recording", "--pictures", "--give-names"):
        if getattr(args, option[2:].replace("-", "_")):
            raise InputError(f"{option} is for keyframes only; {args.truth} is another kind of truth")
    found = evaluate(args.result, args.truth, cloud=args.cloud, trajectory=args.trajectory)
    give(args, found.to_dict(), lambda: print_evaluation(found))
    return 0


def print_evaluation(found: Evaluation) -> None:
    """Print the evaluation as tables."""
    from cuboid.cli.keyframes import print_names, print_reliability

    out = console()
    skipped = f", {found.frames_skipped} skipped" if found.frames_skipped else ""
    out.print(f"{found.result} against {found.truth}: {found.frames_judged} frames judged{skipped}")
    out.print(_map_table(found))
    out.print(_map_line(found))
    if found.identity is None:
        out.print("labels over time: not judged, since the truth has no visibility per frame")
    else:
        out.print(_identity_table(found.identity))
        out.print(_identity_lines(found.identity))
        out.print(_reidentification_table(found.identity))
        print_reliability(found.identity.reliability[-1])
    if found.events is not None:
        out.print(_event_lines(found.events))
    out.print(_objects_table(found))
    if found.names is not None:
        print_names(found.names)
    if found.relations is not None:
        out.print(_relations_table(found.relations))
    if found.heat is not None:
        out.print(_heat_line(found.heat))


def print_visits(found: VisitsQuality) -> None:
    """Print the kept labels and the reported changes over visits."""
    out = console()
    out.print(f"labels kept of objects that did not move: {found.kept} of {found.unmoved}")
    out.print(f"moved objects recognised: {found.recognised} of {found.moved}")
    out.print(f"changes: {found.changes} true, {found.reported} reported, {found.right} of them correct")
    out.print(f"hidden objects reported as gone: {found.hidden_called_gone}")


def print_comparison(found: Evaluation) -> None:
    """Print a short comparison with the truth: each object, its label, its box."""
    out = console()
    out.print(_objects_table(found))
    at = found.map.at[-1]
    wrong = len(found.map.wrong_labels)
    line = f"{at.found} of {found.map.objects} objects found at IoU {at.threshold:g}"
    line += f", {wrong} box{'' if wrong == 1 else 'es'} of no object"
    if found.identity is not None:
        back = found.identity.reidentification[0]
        line += f", HOTA {found.identity.hota.hota:.3f}"
        line += f", {back.same_label} of {back.reappearances} reappearances with the old label"
    out.print(line)


def _length(value_cm: float | None) -> str:
    return "-" if value_cm is None else f"{value_cm:.2f} cm"


def _map_table(found: Evaluation) -> Table:
    table = new_table(
        "map, IoU", "precision", "recall", "F1", "AP", "found", "wrong", "mean IoU", "centre off", "size off"
    )
    for at in found.map.at:
        table.add_row(
            f"{at.threshold:.2f}",
            *map(score, (at.precision, at.recall, at.f1, at.ap)),
            f"{at.found} of {at.found + at.missed}",
            str(at.wrong),
            score(at.mean_iou),
            *map(_length, (at.center_error_cm, at.size_error_cm)),
        )
    return table


def _map_line(found: Evaluation) -> str:
    quality, proposals = found.map, found.proposals
    line = (
        f"objects: {quality.objects}, boxes in the map: {quality.boxes}, judged: {quality.counted}, "
        f"fragments: {quality.fragments}, merges: {quality.merges}, false alarms: {quality.false_alarms}"
    )
    if quality.wrong_labels:
        line += f" (labels without an object: {', '.join(map(str, quality.wrong_labels))})"
    if proposals is not None:
        line += f"\n{score(proposals.per_frame, 2)} boxes per frame before matching: " + "; ".join(
            f"precision {score(at.precision)}, recall {score(at.recall)} at IoU {at.threshold:.2f}"
            for at in proposals.at
        )
    return line


def _identity_table(identity: Identity) -> Table:
    table = new_table("over time, IoU", "IDF1", "IDP", "IDR", "MOTA", "MOTP", "switches", "fragm.", "missed", "wrong")
    for at in identity.at:
        table.add_row(
            f"{at.threshold:.2f}",
            *map(score, (at.idf1, at.id_precision, at.id_recall, at.mota, at.motp)),
            *map(str, (at.switches, at.fragmentations, at.misses, at.false_positives)),
        )
    return table


def _identity_lines(identity: Identity) -> str:
    hota = identity.hota
    return (
        f"HOTA {hota.hota:.3f}, DetA {hota.det_a:.3f}, AssA {hota.ass_a:.3f}, LocA {hota.loc_a:.3f}\n"
        f"label purity {score(identity.label_purity)}, consistency {score(identity.label_consistency)}, "
        f"{score(identity.labels_per_object, 2)} labels per object, "
        f"first label after {score(identity.median_frames_to_first_label, 0)} frames (median)"
    )


def _reidentification_table(identity: Identity) -> Table:
    curve = [at for at in identity.reidentification if at.reappearances] or identity.reidentification[:1]
    table = new_table("absent before for", *(f">= {at.absence_frames} frames" for at in curve))
    table.add_row("reappearances", *(str(at.reappearances) for at in curve))
    table.add_row("found again", *(str(at.found) for at in curve))
    table.add_row("with the old label", *(str(at.same_label) for at in curve))
    table.add_row("re-identification rate", *(score(at.rate) for at in curve))
    return table


def _event_lines(events: EventQuality) -> str:
    frames = events.median_delay_frames
    delay = "" if frames is None else f", reported {frames:.0f} frames later (median)"
    lines = [
        f"events: {events.events} true, {events.reported} reported, {events.right} of them right "
        f"(precision {score(events.precision)}, recall {score(events.recall)}){delay}",
        f"labels given to people: {', '.join(map(str, events.agent_labels)) or 'none'}",
        *(f"not reported: {one}" for one in events.missed),
        *(f"not true: {one}" for one in events.wrong),
    ]
    return "\n".join(lines)


def _heat_line(heat: HeatQuality) -> str:
    line = (
        f"heat against {heat.points} labelled points ({heat.object_points} on objects, "
        f"{100 * (heat.mapped or 0.0):.1f} % of all near the map): AP {score(heat.ap)}"
    )
    if heat.best is not None:
        at = heat.best
        line += f", F {score(at.f)} at heat {at.heat:.2f} (precision {score(at.precision)}, recall {score(at.recall)})"
    return line


def _relations_table(relations: Sequence[RelationsAt]) -> Table:
    table = new_table("relation", "precision", "recall", "right", "found", "true", "objects not found")
    for at in relations:
        counts = map(str, (at.right, at.found, at.true, at.lost))
        table.add_row(at.kind, score(at.precision), score(at.recall), *counts)
    return table


def _objects_table(found: Evaluation) -> Table:
    table = new_table("object", "label", "IoU", "centre off", "labels", "switches", "found in frames", "first after")
    for item in found.objects:
        box, had = item.box, item.labels
        table.add_row(
            item.name,
            "-" if box is None else str(box.label),
            score(None if box is None else box.iou),
            _length(None if box is None else box.center_error_cm),
            "-" if had is None else ", ".join(map(str, had.labels)) or "none",
            "-" if had is None else str(had.switches),
            "-" if had is None else f"{had.frames_found} of {had.frames_to_find}",
            "-" if had is None or had.frames_to_first_label is None else f"{had.frames_to_first_label} frames",
        )
    return table
