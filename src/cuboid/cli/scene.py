"""`cuboid scene`: list, show and change the objects of a scene file."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from cuboid.cli.names import scene_export_names
from cuboid.cli.parser import positive, takes_names
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.scene_documents import change_document, event_document, object_document, relation_document
from cuboid.cli.tables import console, new_table, sized_table
from cuboid.cli.text_model import add_text
from cuboid.ground.core.errors import InputError, printable
from cuboid.ground.formats.folder import REPORT

if TYPE_CHECKING:
    from cuboid.runs.scene import Scene, SceneObject

# The output of a verb: results ready for JSON, and lines to print.
Answer = tuple[dict[str, Any], "list[str | Table]"]

EXAMPLE = "cuboid scene list kitchen.cuboid"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    verbs = parser.add_subparsers(title="verbs", dest="verb", metavar="VERB", required=True)

    def verb(name: str, text: str) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", allow_abbrev=False)
        one.add_argument("scene", type=Path, metavar="FILE", help="the scene (NAME.cuboid)")
        add_results(one)
        return one

    listing = verb("list", "list the present objects")
    listing.add_argument("--all", action="store_true", help="also list gone, merged and forgotten objects")
    showing = verb("show", "show the recordings of the scene, or one object and its sightings")
    showing.add_argument("label", type=positive, nargs="?", metavar="LABEL", help="an object")
    showing.add_argument("--picture", type=Path, metavar="JPG", help="write the object's picture")
    finding = verb("find", "rank the objects by how well their pictures fit a text")
    add_text(finding, required=True)
    finding.add_argument(
        "--limit", type=positive, default=10, metavar="N", help="print at most N objects (default: 10)"
    )
    changing = verb("changes", "list the changes since the previous visit: moved, gone, new")
    changing.add_argument(
        "--since",
        metavar="DATE",
        help="changes of all recordings that began since then (default: of the last recording)",
    )
    changing.add_argument(
        "--all", action="store_true", help="also list unchanged objects, and objects that were not looked at"
    )
    changing.add_argument("--pictures", type=Path, metavar="DIR", help="write pictures of before and after")
    naming = verb("name", "give an object a name; an empty name removes it")
    naming.add_argument("label", type=positive, metavar="LABEL")
    naming.add_argument("name", metavar="NAME")
    merging = verb("merge", "merge two labels of one object; the older label stays")
    merging.add_argument("one", type=positive, metavar="LABEL")
    merging.add_argument("two", type=positive, metavar="LABEL")
    forgetting = verb("forget", "remove an object; its label is never used again")
    forgetting.add_argument("label", type=positive, metavar="LABEL")
    checking = verb("check", "check the file for damage")
    checking.add_argument("--rescue", type=Path, metavar="NEW", help="write the readable part into a new scene file")
    exporting = verb("export", "write the results of a recording for other programs, or as a result folder")
    form = exporting.add_argument("--to", required=True, metavar="NAME", help="the format")
    takes_names(form, scene_export_names)
    add_output(exporting, type=Path, required=True, metavar="PATH", help="the file or the folder")
    exporting.add_argument(
        "--recording", type=positive, metavar="N", help="number of the recording in the scene (default: the last one)"
    )
    verb("compact", "rewrite the file without its unused space")


def run(args: argparse.Namespace) -> int:
    """Run the verb."""
    if args.verb == "check":
        return _check(args)
    if not args.scene.exists():
        raise InputError(f"{args.scene}: there is no such scene file")
    from cuboid.runs.scene import Scene

    with Scene.open(args.scene) as scene:
        document, lines = VERBS[args.verb](scene, args)
    give(args, document, lambda: _print(lines))
    return 0


def _print(lines: list[str | Table]) -> None:
    for line in lines:
        if isinstance(line, str):
            console().print(line)
        else:
            console().print(line)


def _list(scene: Scene, args: argparse.Namespace) -> Answer:
    from cuboid.results.files.object_table import size_cell

    found = [item for item in scene.all_objects if args.all or item.state == "present"]
    document = {"objects": [object_document(item) for item in found]}
    if not found:
        return document, ["no object"]
    state = ("state",) if args.all else ()

    def build(size: str, errors: bool) -> Table:
        others = ("position x, y, z (m)", "last seen", "probability")
        table = new_table("label", "name", *state, size, *others, left=2 + args.all)
        for item in found:
            state_text = item.state if item.merged_into is None else f"merged into {item.merged_into}"
            seen = "recording {}, frame {}".format(*item.last_seen)
            named = (printable(item.name or ""), *((state_text,) if args.all else ()))
            cells = (size_cell(item, errors=errors), item.box.center_text, seen, f"{item.probability:.2f}")
            table.add_row(str(item.label), *named, *cells)
        return table

    return document, [sized_table(build)]


def _show(scene: Scene, args: argparse.Namespace) -> Answer:
    if args.label is not None:
        return _show_object(scene, args)
    if args.picture is not None:
        raise InputError("--picture needs the label of an object")

    gone = len([item for item in scene.all_objects if item.state == "gone"])
    size_mb = scene.path.stat().st_size / 2**20
    table = new_table("recording", "begun (UTC)", "frames", "with a pose", "poses", "whole", "path", left=2)
    for one in scene.recordings:
        whole = "yes" if one.complete else "interrupted"
        poses, path = (printable(text) for text in (one.poses, one.path))
        cells = (one.begun, str(one.frames), str(one.frames_used), poses, whole, path)
        table.add_row(str(one.number), *cells)
    document = {
        "objects": len(scene.objects),
        "gone": gone,
        "bytes": scene.path.stat().st_size,
        "recordings": [asdict(one) for one in scene.recordings],
    }
    return document, [f"{scene.path}: {len(scene.objects)} objects present, {gone} gone; {size_mb:.1f} MB", table]


def _show_object(scene: Scene, args: argparse.Namespace) -> Answer:
    from cuboid.ground.core.results import tag_of
    from cuboid.results.files.pending import write_whole

    item = _object(scene, args.label)
    history = scene.history(args.label)
    state_text = item.state if item.merged_into is None else f"merged into {item.merged_into}"
    lines: list[str | Table] = [f"{tag_of(item.label, item.name)}: {state_text}"]
    lines.append("  size {:.1f} x {:.1f} x {:.1f} cm".format(*(100 * item.box.size)))
    lines.append("  at {:.3f}, {:.3f}, {:.3f} m".format(*item.box.center))
    visits: list[dict[str, Any]] = []
    for number in sorted({past.recording for past in history}):
        visit = [past for past in history if past.recording == number]
        first, last, box = visit[0].frame, visit[-1].frame, visit[-1].box
        frames = {"recording": number, "first_frame": first, "last_frame": last, "sightings": len(visit)}
        visits.append({**frames, "center": [round(float(value), 6) for value in box.center]})
        place = "{:.3f}, {:.3f}, {:.3f}".format(*box.center)
        lines.append(f"  recording {number}: frames {first} to {last}, {len(visit)} of them, at {place} m")
    events = scene.events(args.label)
    lines += [f"  recording {one.recording}, frame {one.frame}: {one.event}" for one in events]
    past = scene.relation_history(args.label)
    for one in past:
        to = tag_of(one.to) if isinstance(one.to, int) else one.to
        when = f"recordings {one.first_recording} to {one.last_recording}"
        lines.append(f"  {one.kind} {to}, {when}; score {one.score:.2f}")
    if args.picture is not None:
        picture = scene.picture(args.label)
        if picture is None:
            raise InputError(f"{scene.path}: no picture of object {args.label}")
        write_whole(args.picture, picture)
        lines.append(f"picture in {args.picture}")
    relations = [relation_document(one) for one in past]
    document = {"object": object_document(item), "recordings": visits, "relations": relations}
    return {**document, "events": [event_document(one) for one in events]}, lines


def _find(scene: Scene, args: argparse.Namespace) -> Answer:
    from cuboid.results.files.object_table import size_cell
    from cuboid.runs.scene import SceneObject

    found = scene.find(args.text, args.text_model)[: args.limit]
    objects = {item.label: item for item in scene.objects if isinstance(item, SceneObject)}
    rows = [{**object_document(objects[item.label]), "text_score": round(score, 6)} for item, score in found]
    if not found:
        return {"objects": rows}, ["no object"]

    def build(size: str, errors: bool) -> Table:
        table = new_table("label", "name", size, "position x, y, z (m)", "text score", left=2)
        for item, score in found:
            cells = (size_cell(item, errors=errors), item.box.center_text, f"{score:.3f}")
            table.add_row(str(item.label), printable(item.name or ""), *cells)
        return table

    return {"objects": rows}, [sized_table(build)]


def _changes(scene: Scene, args: argparse.Namespace) -> Answer:
    from cuboid.results.files.pending import new_folder

    found = [one for one in scene.changes(args.since) if args.all or one.change not in ("unchanged", "not looked at")]
    document = {"changes": [change_document(one) for one in found]}
    if not found:
        return document, ["nothing changed"]
    table = new_table("recording", "label", "name", "change", "from (m)", "to (m)", "metres", "confidence", left=4)
    for one in found:
        places = ("" if p is None else ", ".join(f"{value:z.2f}" for value in p) for p in (one.from_m, one.to_m))
        far = "" if one.metres is None else f"{one.metres:.2f}"
        sure = "" if one.metres is None else f"{one.sure:.2f}"
        name = printable(one.name or "")
        table.add_row(str(one.recording), str(one.label), name, one.change, *places, far, sure)
    if args.pictures is None:
        return document, [table]
    with new_folder(args.pictures, force=True, replaces=r"recording-\d+-label-\d+-(before|after)\.jpg") as folder:
        for one in found:
            for when, picture in (("before", one.before), ("after", one.after)):
                if picture is not None:
                    (folder / f"recording-{one.recording}-label-{one.label}-{when}.jpg").write_bytes(picture)
    return document, [table, f"pictures in {args.pictures}"]


def _object(scene: Scene, label: int) -> SceneObject:
    for item in scene.all_objects:
        if item.label == label:
            return item
    raise InputError(f"{scene.path}: no object has the label {label}")


def _name(scene: Scene, args: argparse.Namespace) -> Answer:
    from cuboid.ground.core.results import tag_of

    scene.name(args.label, args.name)
    name = args.name.strip()
    return {"label": args.label, "name": name}, [tag_of(args.label, name)]


def _merge(scene: Scene, args: argparse.Namespace) -> Answer:
    kept = scene.merge(args.one, args.two)
    return {"label": kept, "merged": [args.one, args.two]}, [f"#{args.one} and #{args.two} are now #{kept}"]


def _forget(scene: Scene, args: argparse.Namespace) -> Answer:
    scene.forget(args.label)
    return {"forgotten": args.label}, [f"#{args.label} is forgotten"]


def _export(scene: Scene, args: argparse.Namespace) -> Answer:
    from cuboid.results.exports import export
    from cuboid.results.files import Results

    document = {"output": str(args.output), "form": args.to}
    if args.to == "results":
        scene.write_results(args.output, args.recording, force=args.force)
        from cuboid.results.views.report import summarise, write_report

        number = len(scene.recordings) if args.recording is None else args.recording
        summary = summarise(Results(args.output), None, scene.shown_changes(number))
        write_report(args.output / REPORT, summary)
        return {**document, "notes": []}, [f"results in {args.output}"]
    with tempfile.TemporaryDirectory(prefix="cuboid-scene-") as work:
        scene.write_results(Path(work) / "results", args.recording)
        notes = export(Results(Path(work) / "results"), args.to, args.output, force=args.force)
    return {**document, "notes": notes}, [f"{args.to} written to {args.output}", *notes]


def _compact(scene: Scene, args: argparse.Namespace) -> Answer:
    before = scene.path.stat().st_size
    scene.compact()
    scene.close()
    after = scene.path.stat().st_size
    sizes = {"bytes_before": before, "bytes_after": after}
    return sizes, [f"{before / 2**20:.1f} MB became {after / 2**20:.1f} MB"]


def _check(args: argparse.Namespace) -> int:
    from cuboid.cli import OK
    from cuboid.cli.parser import MISTAKE
    from cuboid.runs.scene.checking import problems, rescue

    found = problems(args.scene)
    document: dict[str, Any] = {"problems": found}
    lines: list[str | Table] = [*(found or ["no damage found"])]
    if args.rescue is not None:
        lost = rescue(args.scene, args.rescue)
        document |= {"rescued": str(args.rescue), "lost": lost}
        lines += [f"the readable part is in {args.rescue}", *(f"lost: {line}" for line in lost)]
    give(args, document, lambda: _print(lines))
    return MISTAKE if found and args.rescue is None else OK


VERBS = {
    "list": _list,
    "show": _show,
    "find": _find,
    "changes": _changes,
    "name": _name,
    "merge": _merge,
    "forget": _forget,
    "export": _export,
    "compact": _compact,
}
