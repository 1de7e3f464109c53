"""What stands under the names that pages use: a small recording, results, a truth, a store, a scene."""

from __future__ import annotations

import json
import re
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cuboid.cli import main
from made_models import made_model
from made_parcels import write_parcels
from made_rigs import write_rig
from made_text_models import made_text_model

# Length and size of all that is made here, and of what `cuboid synth` and `cuboid demo` make when a page runs them.
FRAMES, SIZE = "24", "160x120"
# Recordings that the pages name; all are the same plain one.
RECORDINGS = ("RECORDING", "my-recording", "monday", "tuesday", "wednesday", "rgbd_dataset_freiburg1_xyz")


def call(*words: object) -> None:
    """Run a command of the program, which has to end well."""
    assert main([str(word) for word in words]) == 0, words


class Given:
    """Makes what pages ask for, each thing once, and copies it to where a page runs.

    Parameters
    ----------
    folder : Path
        An empty one, for what is made.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._makers: dict[str, Callable[[Path], None]] = {
            **dict.fromkeys(RECORDINGS, self._recording),
            **dict.fromkeys(("DIR", "RESULT", "results"), self._results),
            "MODEL.onnx": self._model,
            "MODEL": self._text_model,
            "TRUTH": self._truth,
            "truth.json": self._truth,
            "RECORDING/keyframes.json": self._keyframes,
            "keyframes.json": self._keyframes,
            "RECORDINGS": self._recordings,
            "TRUTHS": self._truths,
            "PARCELS": self._parcels,
            "RIG": self._rig,
            "STORE": self._store,
            "scans.zip": self._zip,
            "scans.tar": self._tar,
            "packed.tar.gz": self._packed_tar,
            "kitchen": self._visits,
            "kitchen.cuboid": self._scene,
        }

    def always(self, text: str) -> list[str]:
        """Return what a page has without asking: what its code names in capitals, and recordings."""
        names = [name for name in self._makers if name.isupper() or self._makers[name] == self._recording]
        names += ["scans.zip", "scans.tar"]
        return [name for name in names if re.search(rf"(?<![\w/.-]){re.escape(name)}(?![\w.-])", text)]

    def put(self, name: str, where: Path) -> None:
        """Put a thing there under its name, unless it is there."""
        target = where / name
        if target.exists():
            return
        made = self.made(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        if made.is_dir():
            shutil.copytree(made, target)
        else:
            shutil.copy(made, target)

    def made(self, name: str) -> Path:
        """Return where a thing lies, after making it if need be."""
        maker = self._makers[name]
        path = self._folder / f"{maker.__name__.strip('_')}{Path(name).suffix}"
        if not path.exists():
            maker(path)
        return path

    def _recording(self, path: Path) -> None:
        call("synth", "--frames", FRAMES, "--size", SIZE, "--sensor", "clean", "--workers", 1, "--output", path)

    def _parcels(self, path: Path) -> None:
        write_parcels(path)

    def _rig(self, path: Path) -> None:
        write_rig(path)

    def _model(self, path: Path) -> None:
        made_model(path, np.zeros((1, 84, 2100), np.float32))

    def _text_model(self, path: Path) -> None:
        made_text_model(path)

    def _results(self, path: Path) -> None:
        call("track", self.made("RECORDING"), "--output", path)

    def _truth(self, path: Path) -> None:
        shutil.copy(self.made("RECORDING") / "truth.json", path)

    def _keyframes(self, path: Path) -> None:
        rectangle = {"id": 1, "rect": [10, 10, 40, 40]}
        document = {
            "format": "cuboid-keyframes",
            "version": 1,
            "objects": [{"id": 1, "name": "mug"}],
            "frames": [{"frame": 8, "boxes": [rectangle]}],
        }
        path.write_text(json.dumps(document))

    def _recordings(self, path: Path) -> None:
        shutil.copytree(self.made("RECORDING"), path / "table")

    def _truths(self, path: Path) -> None:
        path.mkdir()
        shutil.copy(self.made("TRUTH"), path / "table.json")

    def _store(self, path: Path) -> None:
        call("batch", self.made("RECORDINGS"), "--output", path, "--workers", 1)

    def _zip(self, path: Path) -> None:
        shutil.make_archive(str(path.with_suffix("")), "zip", self.made("RECORDING"))

    def _tar(self, path: Path) -> None:
        with tarfile.open(path, "w") as file:
            file.add(self.made("RECORDING"), "house/scene_01")

    def _packed_tar(self, path: Path) -> None:
        with tarfile.open(path, "w:gz") as file:
            file.add(self.made("RECORDING"), "house/scene_01")

    def _visits(self, path: Path) -> None:
        words = ("--visits", 2, "--frames", FRAMES, "--size", SIZE, "--sensor", "clean", "--workers", 1)
        call("synth", *words, "--output", path)

    def _scene(self, path: Path) -> None:
        for number in (1, 2):
            visit = self.made("kitchen") / f"visit-{number}"
            output = path.with_suffix(f".results-{number}")
            call("track", visit, "--output", output, "--scene", path, "--same-world")
