"""Frames that cannot be used: each is one line that names the file, and the recording goes on."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from made_recordings import color_image, depth_image, write_image

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import SkippedFrame
from cuboid.inputs.readers import open_recording


def cut(path, fraction):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * fraction)])


def as_jpeg(made, k):
    file = made.color(k)
    file.unlink()
    write_image(file.with_suffix(".jpg"), color_image(k))
    return file.with_suffix(".jpg")


def flip_byte(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x55
    path.write_bytes(data)


FAULTS = {
    "truncated color png": (lambda m: cut(m.color(2), 0.7), r"color image .*000002\.png is truncated"),
    "truncated depth png": (lambda m: cut(m.depth(2), 0.5), r"depth image .*000002\.png is truncated"),
    "last bytes gone": (
        lambda m: m.depth(2).write_bytes(m.depth(2).read_bytes()[:-3]),
        r"depth image .*000002\.png is truncated",
    ),
    "truncated color jpg": (lambda m: cut(as_jpeg(m, 2), 0.7), r"color image .*000002\.jpg is truncated"),
    "damaged depth": (lambda m: flip_byte(m.depth(2)), r"depth image .*000002\.png is damaged at byte \d+"),
    "empty color": (lambda m: m.color(2).write_bytes(b""), r"color image .*000002\.png is empty \(0 bytes\)"),
    "empty depth": (lambda m: m.depth(2).write_bytes(b""), r"depth image .*000002\.png is empty"),
    "no image": (lambda m: m.color(2).write_bytes(b"hello" * 100), r"000002\.png is neither a PNG nor a JPEG"),
    "a folder": (
        lambda m: (m.color(2).unlink(), m.color(2).mkdir()),
        r"color image .*000002\.png is a folder, a regular file was expected",
    ),
    "color only": (lambda m: m.depth(2).unlink(), r"color without depth: color/000002\.png"),
    "depth only": (lambda m: m.color(2).unlink(), r"depth without color: depth/000002\.png"),
    "both of another size": (
        lambda m: (
            write_image(m.color(2), color_image(2, (24, 32))),
            write_image(m.depth(2), depth_image(2, 1000, (24, 32))),
        ),
        r"the frame is 32x24, the recording 64x48: depth/000002\.png",
    ),
    "depth of another size": (
        lambda m: write_image(m.depth(2), depth_image(2, 1000, (24, 32))),
        r"color is 64x48 but depth 32x24, .*color/000002\.png, depth/000002\.png",
    ),
    "all-zero depth": (
        lambda m: write_image(m.depth(2), np.zeros((48, 64), np.uint16)),
        r"depth/000002\.png has no reading",
    ),
    "saturated depth": (
        lambda m: write_image(m.depth(2), np.full((48, 64), 65535, np.uint16)),
        r"depth/000002\.png has no reading",
    ),
    "8-bit depth": (
        lambda m: write_image(m.depth(2), np.full((48, 64), 100, np.uint8)),
        r"depth/000002\.png must have one channel of 16 bits, it has 1 of 8",
    ),
    "color as depth": (
        lambda m: write_image(m.depth(2), color_image(2)),
        r"must have one channel of 16 bits, it has 3 of 8",
    ),
    "depth of one far wall": (
        lambda m: write_image(m.depth(2), np.full((48, 64), 50000, np.uint16)),
        r"000002\.png reads 50 to 50 m at 1000 units per metre, nothing between 0\.1 and 20 m",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_frame_is_skipped_with_its_reason(plain, fault, capfd):
    spoil, reason = FAULTS[fault]
    spoil(plain)
    recording = open_recording(plain.path)
    with pytest.raises(FrameError, match=reason) as raised:
        recording.read(2)
    items = list(recording.iterate())
    assert [item.index for item in items] == [0, 1, 2, 3, 4]
    assert [type(item) is SkippedFrame for item in items] == [False, False, True, False, False]
    assert items[2].reason == str(raised.value)
    assert "\n" not in items[2].reason
    assert capfd.readouterr().err == ""


def test_size_is_that_of_most_frames_even_where_the_first_differs(plain):
    write_image(plain.color(0), color_image(0, (24, 32)))
    write_image(plain.depth(0), depth_image(0, 1000, (24, 32)))
    recording = open_recording(plain.path)
    assert (recording.intrinsics.width, recording.intrinsics.height) == (64, 48)
    with pytest.raises(FrameError, match="the frame is 32x24"):
        recording.read(0)


def test_nothing_usable_is_said_when_opening(plain):
    for k in range(5):
        plain.depth(k).write_bytes(b"")
    with pytest.raises(InputError, match=r"none of its 5 frames can be used; the first: depth image .*is empty"):
        open_recording(plain.path)


@pytest.mark.parametrize(("scale", "found"), [(1.0, "1000 to 2000"), (1_000_000.0, "0.001 to 0.002")])
def test_a_wrong_depth_scale_is_told_with_the_range_found(plain, scale, found):
    recording = open_recording(plain.path, depth_scale=scale)
    with pytest.raises(FrameError, match=f"reads {found} m at .*nothing between .*; check --depth-scale"):
        recording.read(0)


def test_far_and_near_readings_beside_plausible_ones_are_no_fault(plain):
    depth = depth_image(0, 1000)
    depth[0, 1], depth[0, 2] = 60000, 1
    write_image(plain.depth(0), depth)
    np.testing.assert_allclose(open_recording(plain.path).read(0).depth_m[0, 1:4], [60, 0.001, 1.0], rtol=1e-6)


def test_grey_and_turned_color_images(plain):
    """One channel becomes three; an EXIF turn is left aside, since depth and intrinsics are not turned."""
    write_image(plain.color(0), np.full((48, 64), 77, np.uint8))
    file = as_jpeg(plain, 1)
    plain_jpeg = file.read_bytes()
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    file.write_bytes(plain_jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + plain_jpeg[2:])
    assert cv2.imread(str(file)).shape == (64, 48, 3), "the turn is not in the file"
    recording = open_recording(plain.path)
    assert (recording.read(0).color == 77).all()
    np.testing.assert_allclose(recording.read(1).color[0, 0], [200, 11, 30], atol=4)


def test_padding_behind_a_jpeg_is_no_fault(plain):
    file = as_jpeg(plain, 1)
    file.write_bytes(file.read_bytes() + bytes(64))
    open_recording(plain.path).read(1)
