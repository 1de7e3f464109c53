"""What is fuzzed: good files, and all that reads them."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
for _folder in (HERE.parent, HERE.parent / "readers", HERE.parent / "exports"):
    if str(_folder) not in sys.path:
        sys.path.append(str(_folder))

import made_containers  # noqa: E402
from engine import Target  # noqa: E402
from made_recordings import CAMERA, color_image, depth_image  # noqa: E402
from made_run import finished  # noqa: E402

from cuboid.ground.core.errors import CuboidError  # noqa: E402
from cuboid.ground.core.frame import Intrinsics  # noqa: E402
from cuboid.inputs.readers import open_recording  # noqa: E402
from cuboid.lab.evaluation import evaluate  # noqa: E402
from cuboid.lab.synthetic.user_meshes import load_mesh  # noqa: E402
from cuboid.method.proposals.files import LOADERS  # noqa: E402
from cuboid.results.exports import EXPORTS, export  # noqa: E402
from cuboid.results.files import Results  # noqa: E402
from cuboid.results.views.redraw import KINDS, drawer  # noqa: E402
from cuboid.results.views.replay import Replay  # noqa: E402
from cuboid.results.views.report import page_of, summarise  # noqa: E402

SHAPE = (48, 64)


def frames_of(count: int) -> made_containers.Frames:
    camera = Intrinsics(**CAMERA)  # type: ignore[arg-type]
    color, depth_mm = [color_image(k) for k in range(count)], [depth_image(k, 1000) for k in range(count)]
    return made_containers.Frames(camera, color, depth_mm, [np.eye(4)] * count)


FRAMES = frames_of(4)


def files_of(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def read_all(folder: Path) -> None:
    names = {folder.name, *(part for name in files_of(folder) for part in Path(name).parts)}
    try:
        recording = open_recording(folder)
    except CuboidError as error:
        if not any(name in str(error) for name in names):
            raise AssertionError(f"names no file: {error}") from None
        raise
    lines = [str(item.reason) for item in recording.iterate(prefetch=False) if hasattr(item, "reason")]
    assert all(line.isprintable() and len(line) < 300 for line in lines), lines


# --- results and truth ------------------------------------------------------------------------------------------------


def make_results(folder: Path) -> None:
    camera = {"fx": 64, "fy": 64, "cx": 32, "cy": 24}
    made_containers.plain(frames_of(5), folder / "recording", **camera)
    (folder / "recording" / "timestamps.txt").unlink()
    finished(folder / "results", folder / "recording", 30.0)
    boxes = json.loads((folder / "results" / "objects.json").read_text())["objects"]
    truth = {
        "format": "cuboid-truth",
        "version": 1,
        "name": "by hand",
        "frames": 5,
        "objects": [
            {"id": k + 1, "name": f"thing {k}", "judged": k != 2, "round": k == 1}
            | {name: boxes[min(k, 1)][name] for name in ("center", "size", "rotation")}
            for k in range(3)
        ],
        "judged_region": {
            "normal": [0, 0, 1],
            "offset": -0.7,
            "polygon": [[-1, -1, 0.7], [1, -1, 0.7], [1, 1, 0.7], [-1, 1, 0.7]],
            "hmin": -0.1,
            "hmax": 0.5,
        },
        "ignore": [{"center": [0.9, 0.9, 0.75], "size": [0.1, 0.1, 0.1], "rotation": np.eye(3).tolist()}],
        "visibility": {"frames": 5, "objects": {str(k): [[0.5, 2], [1.0, 3]] for k in (1, 2, 3)}},
    }
    (folder / "truth.json").write_text(json.dumps(truth))
    lines = "".join(f"{k / 30:.6f} {0.02 * k} -1.2 1.4 0 0 0 1\n" for k in range(5))
    (folder / "true_trajectory.txt").write_text(lines)
    _write_cloud(folder / "cloud.ply", labelled=True)
    _write_cloud(folder / "uw.ply", labelled=False)
    (folder / "uw.label").write_text("20\n" + "1\n10\n" * 10)


def _write_cloud(path: Path, *, labelled: bool) -> None:
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), *([("label", "<i4")] if labelled else [])]
    rows = np.zeros(20, kinds)
    for name in "xyz":
        rows[name] = np.linspace(-0.2, 0.8, 20)
    names = {"<f4": "float", "<i4": "int"}
    head = ["ply", "format binary_little_endian 1.0", "element vertex 20"]
    head += [f"property {names[kind]} {name}" for name, kind in kinds]
    path.write_bytes(("\n".join([*head, "end_header"]) + "\n").encode() + rows.tobytes())


def judge(folder: Path, **more: str) -> None:
    named = {name: folder / file for name, file in more.items()}
    json.dumps(evaluate(folder / "results", folder / "truth.json", **named).to_dict(), allow_nan=False)


def show_page(folder: Path) -> None:
    page_of(summarise(Results(folder / "results"), None))


def show_pictures(folder: Path) -> None:
    recording = open_recording(folder / "recording").without_poses()
    page_of(summarise(Results(folder / "results"), recording.read))


def redraw(folder: Path) -> None:
    replay = Replay(folder / "results")
    recording = open_recording(folder / "recording").without_poses()
    drawers = [drawer(what, folder / "results", replay) for what in KINDS]
    for found in replay.frames(recording.timestamp_s):
        if found.index < len(recording):
            frame = recording.read(found.index)
            for draw in drawers:
                draw(frame, found)


def export_to(folder: Path, name: str) -> None:
    form = EXPORTS.get(name)
    out = folder / f"exported-{name}{form.suffix}"
    export(Results(folder / "results", folder / "recording"), name, out)


def evaluate_csv(folder: Path) -> None:
    evaluate(folder / "results" / "tracks.csv", folder / "truth.json")


RESULT_CALLS: dict[str, Callable[[Path], object]] = {
    "evaluate": judge,
    "evaluate in its world": partial(judge, trajectory="true_trajectory.txt"),
    "evaluate heat": partial(judge, cloud="cloud.ply"),
    "evaluate a csv": evaluate_csv,
    "page": show_page,
    "page with pictures": show_pictures,
    "redraw": redraw,
    **{f"export {name}": partial(export_to, name=name) for name in ("coco", "csv", "json", "kitti", "mcap", "ply")},
}


def result_files(folder: Path) -> list[str]:
    return [name for name in files_of(folder) if name.startswith("results/") and "report" not in name]


def truth_files(folder: Path) -> list[str]:
    return ["cloud.ply", "true_trajectory.txt", *["truth.json"] * 8, "uw.label", "uw.ply"]


TRUTH_CALLS: dict[str, Callable[[Path], object]] = {
    "evaluate": judge,
    "evaluate in its world": partial(judge, trajectory="true_trajectory.txt"),
    "evaluate heat": partial(judge, cloud="cloud.ply"),
    "evaluate heat of classes": partial(judge, cloud="uw.ply"),
    "evaluate a csv": evaluate_csv,
}

# --- proposals, meshes ------------------------------------------------------------------------------------------------


def make_proposals(folder: Path) -> None:
    from scipy.io import savemat

    boxes = np.array([[1, 2, 20, 30], [5, 5, 60, 40]], np.float64)
    masks = np.zeros((2, *SHAPE), np.uint8)
    masks[:, 5:20, 5:20] = 1
    scores = np.array([0.5, 0.9])
    rows = "".join(f"{','.join(map(str, box))},0.5\n" for box in boxes.tolist())
    (folder / "0.csv").write_text(f"x0,y0,x1,y1,score\n{rows}")
    np.savez(folder / "1.npz", boxes=boxes, scores=scores)
    np.savez_compressed(folder / "2.npz", masks=masks, scores=scores)
    savemat(folder / "3.mat", {"bboxes": boxes + 1, "bboxes_scores": scores[:, None]})
    savemat(folder / "4.mat", {"masks": np.moveaxis(masks, 0, 2), "scores": scores[:, None]}, do_compression=True)
    cells = np.empty((2, 1), object)
    cells[:, 0] = [np.array([[1, 2]]), np.array([[2]])]
    parts = {"superpixels": masks[0].astype(np.int32) + 1, "labels": cells, "scores": scores[:, None]}
    savemat(folder / "5.mat", {"candidates": parts})


PROPOSALS = ("0.csv", "1.npz", "2.npz", "3.mat", "4.mat", "5.mat")


def load_proposals(folder: Path, name: str) -> None:
    LOADERS[(folder / name).suffix](folder / name, SHAPE[1], SHAPE[0])


def make_meshes(folder: Path) -> None:
    import trimesh

    box = trimesh.creation.box((0.1, 0.1, 0.2))
    for name in MESHES:
        box.export(folder / name)


MESHES = ("a.obj", "b.ply", "c.glb")


def load_named(folder: Path, name: str) -> None:
    load_mesh(folder / name)


TARGETS: dict[str, Target] = {
    "results": Target(make_results, result_files, RESULT_CALLS),
    "truth": Target(make_results, truth_files, TRUTH_CALLS),
    "proposals": Target(
        make_proposals, files_of, {f"load {name}": partial(load_proposals, name=name) for name in PROPOSALS}
    ),
    "meshes": Target(make_meshes, files_of, {f"load {name}": partial(load_named, name=name) for name in MESHES}),
}
