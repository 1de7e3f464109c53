"""Validation of files: what is opened, what is said of what is wrong, and that the documentation is of what is read."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.errors import CuboidError, FrameError, InputError, one_line, shown
from cuboid.ground.core.frame import Frame
from cuboid.ground.formats import reading
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.objects_file import ObjectsDocument
from cuboid.ground.formats.reading import UnreadableError, opened, read_bytes, text_lines
from cuboid.ground.formats.rows_files import TrackEntry
from cuboid.ground.formats.table_validation import read_table
from cuboid.results.files.rows import TRACKS_HEADER


def test_only_regular_files_are_opened_and_none_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "circle").symlink_to("circle")
    (tmp_path / "device").symlink_to("/dev/zero")
    with socket.socket(socket.AF_UNIX) as made:
        monkeypatch.chdir(tmp_path)
        made.bind("socket")
        for name, says in (
            ("fifo", "is a FIFO"),
            ("device", "is a device"),
            ("socket", "is a socket"),
            (".", "is a folder"),
            ("circle", "Too many levels"),
            ("none", "No such file"),
            ("none/a", "No such file"),
            ("a\0b", "no file can"),
            ("x" * 300, "too long"),
        ):
            with pytest.raises(UnreadableError, match=says) as caught, opened(tmp_path / name, 100):
                pass
            assert str(caught.value).isprintable()


def test_no_more_is_read_than_a_file_of_its_kind_can_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 100)
    assert read_bytes(path, 100) == b"x" * 100
    with pytest.raises(UnreadableError, match="is larger than"):
        read_bytes(path, 99)
    path.write_bytes(b"short\n" + b"y" * 20_000)
    with pytest.raises(UnreadableError, match="line 2 is longer than 10000 characters"):
        list(text_lines(path))
    monkeypatch.setattr(reading, "MAX_TEXT_BYTES", 1000)
    with pytest.raises(UnreadableError, match="is larger than"):
        list(text_lines(path))


def test_lines_come_as_they_are_however_they_end(tmp_path: Path) -> None:
    for content in ("a\nb c\n", "a\r\nb c\r\n", "\ufeffa\nb c", "a\rb c"):
        (tmp_path / "file").write_bytes(content.encode("utf-8"))
        assert list(text_lines(tmp_path / "file")) == ["a", "b c"]
    (tmp_path / "file").write_bytes("a\n".encode("utf-16"))
    with pytest.raises(UnreadableError, match="is not a text file"):
        list(text_lines(tmp_path / "file"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"format": "cuboid-objects", "version": 1, "up": [0, 0, "' + "x" * 500 + '"]}', "expected a number"),
        ('{"format": "cuboid-objects", "version": 1, "up": [0, 0, 2]}', r"up\[2\]: .* at most 1.001, got 2"),
        ('{"format": "cuboid-objects", "version": 1, "up": [0, 0, 0.5]}', "up has length 0.5, expected 1"),
        ('{"format": "cuboid-objects", "version": 1, "up": ' + "[" * 100_000, "too deep|expected"),
        ('{"format": "\\u001b[31m\\n", "version": "' + "9" * 10_000 + '"}', r"got '\\x1b\[31m\\n' version '9999"),
        ('{"format": "cuboid-objects", "version": 1,\n\n"up": nope}', "line 3: invalid character"),
        ('{"format": "cuboid-objects", "version": 1' + "0" * 5000 + "}", "version: integer value out of range"),
    ],
)
def test_what_is_wrong_is_said_in_one_short_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "objects.json"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        _whole(path)
    assert str(path) in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300


def _whole(path: Path) -> None:
    """Read a document; where `up` alone is tested, the rest of it is added."""
    text = path.read_text()
    if text.endswith("]}") and '"up"' in text:
        camera = '{"fx": 1, "fy": 1, "cx": 0, "cy": 0, "width": 1, "height": 1}'
        path.write_text(f'{text[:-1]}, "intrinsics": {camera}, "planes": [], "objects": []}}')
    read_json(path, ObjectsDocument)


def test_a_row_is_checked_cell_by_cell(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    good = "0,0.5,1,0,0,0,1,1,1,1,0,0,0,,0.5,0,0,10,10,0.9"
    path.write_text(f"{TRACKS_HEADER}\n{good}\n")
    assert [row.iou for _, row in read_table(path, TrackEntry)] == [None]
    for column, cell, says in (
        (0, "-1", "frame: expected a whole number of at least 0, got '-1'"),
        (1, "inf", "timestamp: expected a finite number, got 'inf'"),
        (2, "1e3.5", "label: expected a whole number, got '1e3.5'"),
        (9, "0.5", "the quaternion has length 0.5"),
        (14, "1.5", "visible: expected a number of at most 1, got '1.5'"),
        (17, "-3", "the rectangle ends before it begins"),
        (19, "1.1", "probability: expected a number of at most 1, got '1.1'"),
        (3, "z" * 3000, "cx: expected a number, got 'zzz"),
    ):
        cells = good.split(",")
        cells[column] = cell
        path.write_text(f"{TRACKS_HEADER}\n{good}\n{','.join(cells)}\n")
        with pytest.raises(InputError, match=f"tracks.csv:3: {says}") as caught:
            list(read_table(path, TrackEntry))
        assert len(str(caught.value)) < 300


def test_messages_are_printable_and_short_whatever_is_in_them() -> None:
    message = str(CuboidError("a\nb\x1b[31m\u202e\udcff" + "x" * 5000 + " end"))
    assert message.isprintable()
    assert message.startswith("a b\\x1b[31m\\u202e\\udcff")
    assert message.endswith("end")
    assert len(message) < 300
    assert one_line("whole") == "whole"
    assert len(shown([[1.0] * 1000] * 1000)) <= 80
    assert shown(10**5000) == "a whole number of 16610 bits"


def test_a_pose_that_is_not_rigid_stops_at_the_frame() -> None:
    color, depth = np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32)
    for change, says in ((1.07, "not rigid"), (np.nan, "NaN or infinite"), (-1.0, "not rigid")):
        T = np.eye(4)
        T[:3, 0] *= change
        with pytest.raises(FrameError, match=f"frame 3: .*{says}"):
            Frame(3, 0.0, color, depth, T)
    far = np.eye(4)
    far[0, 3] = 1e7
    with pytest.raises(FrameError, match="away, expected at most"):
        Frame(3, 0.0, color, depth, far)
    T = np.eye(4)
    T[:3, :3] *= 1.001  # three digits
    made = Frame(3, 0.0, color, depth, T).T_world_camera
    assert made is not None
    assert np.linalg.det(made[:3, :3]) == pytest.approx(1.0, abs=1e-12)
    assert Frame(3, 0.0, color, depth, np.eye(4)).T_world_camera is not None
