"""Make the pictures of the gallery and of "it finds nothing" from results: docs/gallery/*.jpg.

    python docs/make_gallery.py [RESULTS ...]
    python docs/make_gallery.py --data DATA

Each RESULTS is a folder of `cuboid track` whose recording still lies where it was. Without one, recordings with known
truth are made and tracked, which takes some minutes; two of them are spoiled, for the pictures of symptoms. With
--data, the real recordings in DATA are tracked. Pictures of those whose licence allows it go to docs/gallery, others to
docs/gallery/real, which is no part of the repository; `docs/real_pictures.py` shows them in the pages.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from cuboid.inputs.readers import Recording
from cuboid.method.proposals import make_source
from cuboid.results.views.redraw import KINDS, drawer
from cuboid.results.views.replay import Replay, ReplayedFrame
from cuboid.results.views.text import put_text

GALLERY = Path(__file__).resolve().parent / "gallery"
MADE = ("table", "clutter", "room")
SEED, FRAMES = "3", "150"
PANEL = (480, 360)
QUALITY = 82
PAPER, INK, BAR = (250, 250, 251), (30, 34, 40), (52, 116, 196)
# Frames over which the funnel counts.
COUNTED = 12
# The faults of the pictures of symptoms: depth beside color, pixels, and the drift of a frame, metres.
SHIFT_PX, DRIFT_M = 30, 0.002


@dataclass(frozen=True)
class Real:
    """A real recording: its folder in DATA, options of `cuboid track`, and what the gallery says of it.

    `free`: its licence allows pictures of it in the repository.
    """

    folder: str
    options: tuple[str, ...]
    title: str
    source: str
    free: bool = False


REAL = {
    "desk": Real("desk-realsense", (), "An office desk, RealSense D435", "github.com/tronphan/3D-Rendering"),
    "tum": Real(
        "rgbd_dataset_freiburg1_xyz",
        (),
        "A cluttered desk, first Kinect",
        "fr1/xyz of TUM RGB-D (Sturm et al., IROS 2012), CC BY 4.0",
        free=True,
    ),
    "coffee-table": Real(
        "rgbd-scenes-v2",
        ("--every", "3"),
        "A coffee table, first Kinect",
        "UW RGB-D Scenes v2 (Lai, Bo, Fox, ICRA 2014)",
    ),
    "office": Real("office-scan", (), "A scanned office, rendered", "office_0 of Replica (Straub et al., 2019)"),
    "dish": Real("dish-from-above", (), "A dish from straight above", "github.com/antunsz/projeto-ovni"),
    "open3d": Real("containers/open3d", (), "A living room of Open3D's", "isl-org/Open3D, MIT licence"),
}
# The one whose funnel, heat and planes stand in "it finds nothing".
TROUBLED = "tum"


def main() -> None:
    """Make the results that are wanted, draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", nargs="*", type=Path, help="folders of `cuboid track`")
    parser.add_argument("--data", type=Path, help="folder with real recordings")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if args.data is not None:
            draw_real(args.data, Path(folder))
            return
        if not args.results:
            symptoms(Path(folder))
        folders = args.results or [made(Path(folder), kind) for kind in MADE]
        for results in folders:
            draw(results, GALLERY)
        troubles(folders[-1], GALLERY)


def draw_real(data: Path, folder: Path) -> None:
    """Track and draw the real recordings that are there, and note which they are."""
    sheets = []
    for name, real in REAL.items():
        if not (data / real.folder).is_dir():
            print(f"{data / real.folder}: is not there, left out")
            continue
        results = folder / name
        words = ("track", data / real.folder, "--output", results, *real.options)
        subprocess.run([sys.executable, "-m", "cuboid", *map(str, words)], check=True)
        draw(results, GALLERY if real.free else GALLERY / "real")
        if name == TROUBLED:
            troubles(results, GALLERY / "real")
        if real.free:
            continue  # docs/results.md shows it
        sheets.append({"name": name, "title": real.title, "source": f"Recording: {real.source}."})
    (GALLERY / "real" / "index.json").write_text(json.dumps(sheets, indent=1), encoding="utf-8")


def made(folder: Path, kind: str) -> Path:
    """Make a recording of a kind, track it, and return its results."""
    recording, results = folder / f"made-{kind}", folder / kind
    for words in (
        ("synth", "--kind", kind, "--seed", SEED, "--frames", FRAMES, "--output", recording),
        ("track", recording, "--output", results),
    ):
        subprocess.run([sys.executable, "-m", "cuboid", *map(str, words)], check=True)
    return results


def symptoms(folder: Path) -> None:
    """Draw what depth beside color and drifting poses look like, each beside the same frame as it should be."""
    good = folder / "made-symptoms"
    words = ("synth", "--kind", "table", "--seed", SEED, "--frames", FRAMES, "--output", good)
    subprocess.run([sys.executable, "-m", "cuboid", *map(str, words)], check=True)
    for name, spoil in {"depth-beside-color": shift_depth, "poses-that-drift": drift}.items():
        bad = folder / f"made-{name}"
        shutil.copytree(good, bad)
        spoil(bad)
        replays = []
        for recording, results in ((bad, folder / f"bad-{name}"), (good, folder / f"good-{name}")):
            words = ("track", recording, "--output", results, "--register", "off", "--poses", "given")
            subprocess.run([sys.executable, "-m", "cuboid", *map(str, words)], check=True)
            replays.append((results, Replay(results)))
        shown = fullest(replays[0][1], replays[0][1].recording).index
        panels = []
        for results, replay in replays:
            recording = replay.recording
            found = next(frame for frame in replay.frames(recording.timestamp_s) if frame.index == shown)
            panels.append(panel(results, replay, recording, found, "boxes"))
        write(GALLERY / f"symptom-{name}", np.hstack(panels))


def shift_depth(recording: Path) -> None:
    """Move each depth image, as it lies where it is not registered to color."""
    for file in (recording / "depth").iterdir():
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), np.roll(depth, SHIFT_PX, axis=1))


def drift(recording: Path) -> None:
    """Add to each pose what a tracker that drifts adds."""
    poses = recording / "poses.txt"
    head, *rows = poses.read_text(encoding="utf-8").splitlines()
    for k, row in enumerate(rows):
        number, x, *rest = row.split()
        rows[k] = " ".join((number, str(float(x) + DRIFT_M * k), *rest))
    poses.write_text("\n".join((head, *rows)), encoding="utf-8")


def draw(results: Path, gallery: Path) -> None:
    """Draw the frame that sees most: labels, heat, own proposals, planes."""
    replay = Replay(results)
    recording = replay.recording
    found = fullest(replay, recording)
    panels = [panel(results, replay, recording, found, what) for what in ("boxes", "heat", "proposals", "planes")]
    write(gallery / results.name, np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])]))


def troubles(results: Path, gallery: Path) -> None:
    """Draw what one looks at where nothing is found: heat, planes, and how many pass each stage."""
    replay = Replay(results)
    recording = replay.recording
    found = fullest(replay, recording)
    for what in ("heat", "planes"):
        write(gallery / f"look-at-{what}", panel(results, replay, recording, found, what))
    write(gallery / "look-at-funnel", funnel(replay, recording))


def fullest(replay: Replay, recording: Recording) -> ReplayedFrame:
    """Return the last frame that sees most objects."""
    return max(replay.frames(recording.timestamp_s), key=lambda found: (len(found.sightings), found.index))


def panel(results: Path, replay: Replay, recording: Recording, found: ReplayedFrame, what: str) -> np.ndarray:
    """Return a picture of a frame with its name."""
    picture = drawer(what, results, replay)(recording.read(found.index), found)
    small = np.ascontiguousarray(cv2.resize(picture, PANEL, interpolation=cv2.INTER_AREA))
    put_text(small, KINDS[what], 10, PANEL[1] - 50, 16, (245, 246, 248))
    return small


def funnel(replay: Replay, recording: Recording) -> np.ndarray:
    """Return bars of how many there are a frame: 2D proposals, the frame's own boxes, labelled sightings."""
    frames = list(replay.frames(recording.timestamp_s))
    frames = frames[:: max(1, len(frames) // COUNTED)]
    propose = make_source(None)
    counts = {
        "2D proposals": np.mean([len(propose(recording.read(f.index), recording.intrinsics)) for f in frames]),
        "the frame's own 3D boxes": np.mean([len(f.proposals) for f in frames]),
        "labelled sightings": np.mean([len(f.sightings) for f in frames]),
    }
    picture = np.full((190, 2 * PANEL[0], 3), PAPER, np.uint8)
    longest = max(counts.values())
    for row, (name, count) in enumerate(counts.items()):
        top = 20 + 54 * row
        put_text(picture, name, 20, top + 8, 17, INK)
        end = 300 + round(560 * float(count / longest))
        cv2.rectangle(picture, (300, top), (max(end, 302), top + 34), BAR, cv2.FILLED)
        put_text(picture, f"{count:.1f}", max(end, 302) + 10, top + 8, 17, INK)
    return picture


def write(name: Path, picture: np.ndarray) -> None:
    """Write a picture, RGB."""
    file = name.with_suffix(".jpg")
    file.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(file), np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    print(file)


if __name__ == "__main__":
    main()
