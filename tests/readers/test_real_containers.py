"""Real files of other programs and cameras."""

from __future__ import annotations

import numpy as np
import pytest

from cuboid.ground.core.frame import Intrinsics
from cuboid.inputs.calibration.registering import find_misregistration
from cuboid.inputs.readers import open_recording

BAGS = "bags are read with rosbags: pip install '.[ros]'"


def test_open3d_s_own_folder(data_dir):
    recording = open_recording(data_dir / "containers" / "open3d")
    assert (recording.format, len(recording), recording.has_poses) == ("open3d", 30, True)
    assert recording.intrinsics == Intrinsics(525, 525, 319.5, 239.5, 640, 480)
    assert recording.depth_units_per_metre == 1000
    np.testing.assert_allclose(recording.pose(0), np.eye(4), atol=1e-9)
    np.testing.assert_allclose(recording.pose(1)[:3, 3], [0.00118646, -0.02351636, -0.00144057], atol=1e-8)
    frame = recording.read(29)
    assert frame.color.shape == (480, 640, 3)
    assert 0.4 < np.median(frame.depth_m[frame.depth_m > 0]) < 4


def test_a_real_file_of_azure_kinect(data_dir):
    recording = open_recording(data_dir / "containers" / "azure-kinect")
    assert (recording.format, len(recording), recording.has_poses) == ("azure-kinect", 1, False)
    K, depth = recording.intrinsics, recording.depth_camera
    assert (K.width, K.height, *depth.size) == (1280, 720, 640, 576)
    assert (K.fx, K.cx, depth.fx, depth.cy) == pytest.approx((611.795, 639.304, 504.608, 348.830), abs=1e-3)
    assert depth.T_color_depth[0, 3] == pytest.approx(-0.03208, abs=1e-5)
    assert len(recording.distortion) == len(depth.distortion) == 8
    frame = recording.read(0)
    assert frame.color.shape == (720, 1280, 3)
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(1.443, abs=0.01)
    assert (frame.depth_m > 0).mean() > 0.5


def test_a_recording_of_the_realsense_sdk(data_dir):
    pytest.importorskip("rosbags", reason=BAGS)
    recording = open_recording(data_dir / "containers" / "realsense")
    assert (recording.format, len(recording), recording.has_poses) == ("realsense-bag", 1, False)
    assert recording.path.name == "single_depth_color_640x480.bag"
    K, depth = recording.intrinsics, recording.depth_camera
    assert (K.width, K.height, K.fx, K.cy) == pytest.approx((640, 480, 613.2037, 239.183), abs=1e-3)
    assert (depth.fx, depth.cx, *depth.size) == pytest.approx((390.4315, 331.388, 640, 480), abs=1e-3)
    np.testing.assert_allclose(depth.T_color_depth[:3, 3], [0.014311, 0.000602, 0.000611], atol=1e-6)
    assert recording.depth_units_per_metre == pytest.approx(1000)
    assert recording.timestamp_s(0) == pytest.approx(0.0544244)  # counted from the start
    frame = recording.read(0)
    assert frame.color.shape == (480, 640, 3)
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(1.35, abs=0.2)
    assert find_misregistration([frame]).off_px < 10  # the ends of surfaces lie where color shows edges
