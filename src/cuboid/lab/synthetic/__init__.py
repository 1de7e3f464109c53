"""Synthetic recordings with exact ground truth, from a seed: scenes, camera paths, sensors, faults.

`make_scene` (or `demo_scene`) places the objects and plans the camera path; `render_recording` writes the recording and
its ground truth.
"""

from __future__ import annotations

from cuboid.lab.synthetic.demo import demo_scene
from cuboid.lab.synthetic.kinds import KINDS, make_scene
from cuboid.lab.synthetic.recording import render_recording
from cuboid.lab.synthetic.rigs import make_rig
from cuboid.lab.synthetic.scene import Scene
from cuboid.lab.synthetic.visits import make_visits, render_visits

__all__ = ["KINDS", "Scene", "demo_scene", "make_rig", "make_scene", "make_visits", "render_recording", "render_visits"]
