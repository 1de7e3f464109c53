"""Make the pictures of the gallery and of "it finds nothing" from results: docs/gallery/*.jpg.

    python docs/make_gallery.py [RESULTS ...]

Each RESULTS is a folder of `cuboid track` whose recording still lies where it was. Without one, recordings with known
truth are made and tracked, which takes some minutes.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from cuboid.proposals import make_source
from cuboid.readers import Recording
from cuboid.views.redraw import KINDS, drawer
from cuboid.views.replay import Replay, ReplayedFrame
from cuboid.views.text import put_text

GALLERY = Path(__file__).resolve().parent / "gallery"
MADE = ("table", "clutter", "room")
SEED, FRAMES = "3", "150"
PANEL = (480, 360)
QUALITY = 82
PAPER, INK, BAR = (250, 250, 251), (30, 34, 40), (52, 116, 196)
# Frames over which the funnel counts.
COUNTED = 12


def main() -> None:
    """Make the results that are wanted, draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", nargs="*", type=Path, help="folders of `cuboid track`")
    named = parser.parse_args().results
    GALLERY.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        folders = named or [made(Path(folder), kind) for kind in MADE]
        for results in folders:
            draw(results)
        troubles(folders[-1])


def made(folder: Path, kind: str) -> Path:
    """Make a recording of a kind, track it, and return its results."""
    recording, results = folder / f"made-{kind}", folder / kind
    for words in (
        ("synth", "--kind", kind, "--seed", SEED, "--frames", FRAMES, "--output", recording),
        ("track", recording, "--output", results),
    ):
        subprocess.run([sys.executable, "-m", "cuboid", *map(str, words)], check=True)
    return results


def draw(results: Path) -> None:
    """Draw the frame that sees most: labels, heat, own proposals, planes."""
    replay = Replay(results)
    recording = replay.reopen(None)
    found = fullest(replay, recording)
    panels = [panel(results, replay, recording, found, what) for what in ("boxes", "heat", "proposals", "planes")]
    write(results.name, np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])]))


def troubles(results: Path) -> None:
    """Draw what one looks at where nothing is found: heat, planes, and how many pass each stage."""
    replay = Replay(results)
    recording = replay.reopen(None)
    found = fullest(replay, recording)
    for what in ("heat", "planes"):
        write(f"look-at-{what}", panel(results, replay, recording, found, what))
    write("look-at-funnel", funnel(replay, recording))


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


def write(name: str, picture: np.ndarray) -> None:
    """Write a picture, RGB."""
    file = GALLERY / f"{name}.jpg"
    cv2.imwrite(str(file), np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    print(file)


if __name__ == "__main__":
    main()
