"""Where up is: in camera.json, in the worlds of phones, and by the accelerometers of bags."""

from __future__ import annotations

import json

import numpy as np
import pytest
from made_bags import START_NS, make_bag, time_of, writing
from made_recordings import CAMERA, color_image, depth_image, make_plain

from cuboid.cli import main
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.inputs.readers import open_recording


def say_up(folder, up):
    document = json.loads((folder / "camera.json").read_text()) | {"up_world": up}
    (folder / "camera.json").write_text(json.dumps(document))


def test_a_plain_folder_says_it_in_camera_json(tmp_path, capsys):
    folder = make_plain(tmp_path).path
    assert open_recording(folder).up_world is None
    assert open_recording(folder).up_camera(0) is None
    say_up(folder, [0, -0.6, 0.8])
    (folder / "poses.txt").write_text("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1 0\n")  # the second: half a turn about z
    recording = open_recording(folder)
    np.testing.assert_allclose(recording.up_world, [0, -0.6, 0.8])
    np.testing.assert_allclose(recording.up_camera(0), [0, -0.6, 0.8])
    np.testing.assert_allclose(recording.up_camera(1), [0, 0.6, 0.8], atol=1e-12)
    with pytest.raises(FrameError, match=r"poses\.txt has no line for frame number 3"):
        recording.up_camera(3)
    np.testing.assert_allclose(recording.read(1).up_camera, [0, 0.6, 0.8], atol=1e-12)
    assert recording.without_poses().up_world is None  # its world is not known then
    given = open_recording(folder, intrinsics=(60, 61, 31.5, 23.5))
    np.testing.assert_allclose(given.up_world, [0, -0.6, 0.8])
    assert main(["info", str(folder)]) == 0
    assert "up            0, -0.6, 0.8 in the world of the poses" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("up", "says"),
    [
        ([0, 0, 2], r"up_world.*1\.001"),
        ([0, 0, 0.5], "'up_world' has length 0.5, expected 1"),
        ([0, 1], "up_world"),
        ("up", "up_world"),
    ],
)
def test_what_is_no_direction_is_refused(tmp_path, up, says):
    folder = make_plain(tmp_path).path
    say_up(folder, up)
    with pytest.raises(InputError, match=says):
        open_recording(folder)


def test_what_is_converted_keeps_it(tmp_path):
    folder = make_plain(tmp_path).path
    say_up(folder, [0, 0, -1])
    for form in ("plain", "tum"):
        assert main(["convert", str(folder), "--to", form, "--output", str(tmp_path / form)]) == 0
        np.testing.assert_allclose(open_recording(tmp_path / form).up_world, [0, 0, -1])


def test_an_accelerometer_that_tf_fixes_to_the_camera(tmp_path):
    path, optical = tmp_path / "a.bag", "camera_color_optical_frame"
    with writing(path, "bag") as (make, publish):
        quarter = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))  # the accelerometer's x is the camera's y
        publish("/tf_static", make.transform(optical, "imu", START_NS, (0.0, 0.0, 0.0), quarter), START_NS)
        publish("/camera/color/camera_info", make.info(CAMERA, optical, START_NS), START_NS)
        for k in range(40):  # before it anything else: rates of turn alone, another body
            t = START_NS + k * 10_000_000
            publish("/camera/gyro", make.imu("imu", t, (0.0, 0.0, 0.0)), t)
            publish("/a_body/imu", make.imu("body", t, (9.81, 0.0, 0.0)), t)
            shake = 0.5 * (-1) ** k
            publish("/camera/imu", make.imu("imu", t, (-9.8 + shake, 0.1, 0.0)), t)
        for k in range(3):
            t = time_of(k)
            publish("/camera/color/image_raw", make.image(color_image(k), "rgb8", optical, t), t)
            publish(
                "/camera/aligned_depth_to_color/image_raw", make.image(depth_image(k, 1000), "16UC1", optical, t), t
            )
        t = START_NS + 3_000_000_000  # long after the last measurement
        publish("/camera/color/image_raw", make.image(color_image(3), "rgb8", optical, t), t)
        publish("/camera/aligned_depth_to_color/image_raw", make.image(depth_image(3, 1000), "16UC1", optical, t), t)
    recording = open_recording(path)
    assert (recording.up_world, recording.up_measured) == (None, True)
    np.testing.assert_allclose(recording.up_camera(1), [-0.0102, -1, 0], atol=3e-3)
    with pytest.raises(FrameError, match=r"/camera/imu has no measurement within 250 ms"):
        recording.up_camera(3)


def test_the_accelerometer_of_a_realsense_camera(tmp_path):
    with writing(tmp_path / "a.bag", "bag") as (make, publish):
        stems = ["/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0", "/device_0/sensor_2/Accel_0"]
        for stem in stems[:2]:
            publish(f"{stem}/info/camera_info", make.info(CAMERA, "", START_NS), START_NS)
        for stem, turn in ((stems[1], (0, 0, 0, 1)), (stems[2], (1.0, 0.0, 0.0, 0.0))):  # half a turn about x
            vector = make("geometry_msgs/msg/Vector3", x=0.01, y=0.0, z=0.0)
            x, y, z, w = map(float, turn)
            rotation = make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
            message = make("geometry_msgs/msg/Transform", translation=vector, rotation=rotation)
            publish(f"{stem}/tf/0", message, START_NS)
        for k in range(4):
            t = time_of(k)
            publish(f"{stems[1]}/image/data", make.image(color_image(k), "rgb8", "", t), t)
            publish(f"{stems[0]}/image/data", make.image(depth_image(k, 1000), "mono16", "", t), t)
            publish(f"{stems[2]}/imu/data", make.imu("", t, (0.0, 9.6, 0.0)), t)
    recording = open_recording(tmp_path / "a.bag")
    assert recording.format == "realsense-bag"
    np.testing.assert_allclose(recording.up_camera(2), [0, -1, 0], atol=1e-9)


def test_a_camera_that_is_shaken_says_nothing(tmp_path):
    optical = "camera_color_optical_frame"
    with writing(tmp_path / "a.bag", "bag") as (make, publish):
        publish("/camera/color/camera_info", make.info(CAMERA, optical, START_NS), START_NS)
        for k in range(30):
            t = time_of(k)
            publish("/imu", make.imu(optical, t, (0.0, -9.81, 0.0) if k == 0 else (0.0, -9.81, 12.0)), t)
            if k in (1, 29):
                publish("/color", make.image(color_image(k), "rgb8", optical, t), t)
                publish("/depth_registered", make.image(depth_image(k, 1000), "16UC1", optical, t), t)
    recording = open_recording(tmp_path / "a.bag", intrinsics=(60, 61, 31.5, 23.5))
    with pytest.raises(FrameError, match=r"/imu measures 15\.5 m/s\^2, which is not gravity alone"):
        recording.up_camera(1)


def test_bags_without_one(tmp_path):
    recording = open_recording(make_bag(tmp_path / "a.bag", "bag"))
    assert not recording.up_measured
    assert recording.up_camera(0) is None


def test_a_real_phone_has_walls_upright_in_its_world(data_dir):
    pytest.importorskip("OpenEXR", reason="depth of Record3D is read with OpenEXR: pip install '.[phone]'")
    recording = open_recording(data_dir / "containers" / "record3d-exr")
    frame = recording.read(0)
    v, u = np.indices(frame.depth_m.shape)
    points = recording.intrinsics.points(u, v, frame.depth_m)[::20, ::20]
    normals = np.cross(np.diff(points, axis=0)[:, :-1], np.diff(points, axis=1)[:-1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
    wall = np.median(normals.reshape(-1, 3), axis=0)  # a door fills the picture
    assert abs(wall @ recording.up_camera(0)) / np.linalg.norm(wall) < 0.05
