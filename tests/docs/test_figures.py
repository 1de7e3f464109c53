"""A figure that several pages give is the same on all of them."""

from __future__ import annotations

import re

from blocks import REPOSITORY


def test_the_time_of_a_frame_is_the_measured_one() -> None:
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    row = re.search(r"^\| a frame, [^|]*`cuboid bench`[^|]*\| ([^|]+?) \|", readme, re.MULTILINE)
    assert row is not None
    measured = (REPOSITORY / "BENCHMARK.md").read_text(encoding="utf-8")
    speed = measured[measured.index("## Speed") :].split("\n## ")[0]
    assert "cuboid bench DATA/rgbd-scenes-v2 --threads 1" in speed
    assert f"The median frame is {row[1]}," in speed


def test_the_boxes_of_scene_01_have_one_mean_iou() -> None:
    measured = (REPOSITORY / "BENCHMARK.md").read_text(encoding="utf-8")
    row = re.search(r"^\| mean IoU of the five \| ([\d.]+) \| ([\d.]+) \|", measured, re.MULTILINE)
    assert row is not None
    assert f"| mean IoU of the boxes | {row[1]} |" in (REPOSITORY / "README.md").read_text(encoding="utf-8")
