"""Make docs/shapes.png, meshes of the objects of a made table: ``python docs/shapes_picture.py``.

Needs the development requirements. The recording is made and tracked anew.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import cuboid
from cuboid.method.shapes import ObjectMesh
from cuboid.results.exports.shapes import GUESSED_RGB

DOCS = Path(__file__).resolve().parent
# The table, and the labels shown.
SEED, SHOWN = 1, (1, 3, 6, 8)
ROWS = (("as seen", {}, 25), ("--close", {"close": True}, -15), ("--complete", {"complete": True}, 25))
LIGHT = np.array([0.4, -0.5, 0.77])


def draw(axes: Any, mesh: ObjectMesh, item: cuboid.TrackedObject, elevation_deg: float) -> None:
    """Draw a mesh, shaded, in its box's own axes."""
    corners = ((mesh.vertices - item.box.center) @ item.box.rotation)[mesh.faces]
    color = mesh.rgb[mesh.faces].mean(axis=1) / 255.0
    color[mesh.guessed_faces] = np.array(GUESSED_RGB) / 255.0
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    color = np.clip(color * (0.65 + 0.5 * np.clip(normal @ LIGHT, 0, 1))[:, None], 0, 1)
    axes.add_collection3d(Poly3DCollection(corners, facecolors=color, edgecolors=color, linewidths=0.2))
    half = item.box.size.max() / 2.0
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(-half, half))
    axes.set_box_aspect((1, 1, 1), zoom=1.0)
    axes.view_init(elevation_deg, -50)
    axes.set_axis_off()


def main() -> None:
    """Make recording, results and picture."""
    mpl.use("Agg")
    with tempfile.TemporaryDirectory() as work:
        recording, folder = Path(work) / "recording", Path(work) / "results"
        call = [sys.executable, "-m", "cuboid"]
        subprocess.run([*call, "synth", "--seed", str(SEED), "--output", str(recording)], check=True)
        subprocess.run([*call, "track", str(recording), "--output", str(folder)], check=True)
        results = cuboid.open_results(folder)
        figure = plt.figure(figsize=(10, 7.2), dpi=100, facecolor="white")
        for row, (title, options, elevation_deg) in enumerate(ROWS):
            for column, label in enumerate(SHOWN):
                axes = figure.add_subplot(len(ROWS), len(SHOWN), row * len(SHOWN) + column + 1, projection="3d")
                draw(axes, results.mesh(label, **options), results.objects.find(label), elevation_deg)
            figure.text(0.01, 1.0 - (row + 0.08) / len(ROWS), title, fontsize=12, family="monospace")
        figure.subplots_adjust(0.02, 0.0, 1.0, 0.98, 0.0, 0.0)
        figure.savefig(DOCS / "shapes.png")


if __name__ == "__main__":
    main()
