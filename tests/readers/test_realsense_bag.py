from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags are read with rosbags: pip install '.[ros]'")

from made_bags import START_NS, time_of, writing
from made_recordings import CAMERA, color_image, depth_image

from cuboid.ground.core.errors import InputError
from cuboid.inputs.calibration.registering import find_misregistration
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.bag import Bag


def test_a_recording_of_the_sdk(data_dir):
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


def test_what_lies_in_the_file_of_the_sdk(data_dir):
    bag = Bag([data_dir / "containers" / "realsense" / "single_depth_color_640x480.bag"])
    stems = {"Depth": "/device_0/sensor_0/Depth_0", "Color": "/device_0/sensor_1/Color_0"}
    for kind, count, encoding in (("Depth", 2, "mono16"), ("Color", 1, "rgb8")):
        stem = stems[kind]
        assert (len(bag.times(f"{stem}/image/data")), len(bag.times(f"{stem}/info/camera_info"))) == (count, 1)
        image = bag.first(f"{stem}/image/data")
        assert (image.encoding, image.width, image.height) == (encoding, 640, 480)
        assert bag.first(f"{stem}/tf/0") is not None
    assert bag.first("/device_0/sensor_0/option/Depth Units/value").data == pytest.approx(0.001)


def make_sdk_bag(path, streams=("Color", "Depth")):
    with writing(path, "bag") as (make, publish):
        sensors = {"Depth": "/device_0/sensor_0", "Color": "/device_0/sensor_1"}
        units = make("std_msgs/msg/Float32", data=0.0001)
        publish("/device_0/sensor_0/option/Depth Units/value", units, START_NS)
        for stream in streams:
            stem = f"{sensors[stream]}/{stream}_0"
            publish(f"{stem}/info/camera_info", make.info(CAMERA, "", START_NS), START_NS)
        for k in range(3):
            if "Color" in streams:
                color = make.image(color_image(k)[..., ::-1], "bgr8", "", time_of(k))
                publish("/device_0/sensor_1/Color_0/image/data", color, time_of(k))
            if "Depth" in streams:
                depth = make.image(depth_image(k, 10000.0), "mono16", "", time_of(k))
                publish("/device_0/sensor_0/Depth_0/image/data", depth, time_of(k))
    return path


def test_depth_units_and_frames_of_a_made_one(tmp_path):
    recording = open_recording(make_sdk_bag(tmp_path / "r.bag"))
    assert (len(recording), recording.depth_units_per_metre) == (3, pytest.approx(10000))
    frame = recording.read(2)
    np.testing.assert_array_equal(frame.color, color_image(2))
    np.testing.assert_allclose(frame.depth_m[10, 5:30], 1.02, atol=1e-4)


def test_without_color_it_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no color images; both color and depth must have been recorded"):
        open_recording(make_sdk_bag(tmp_path / "r.bag", ("Depth",)))
