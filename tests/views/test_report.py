"""What Python puts into the page."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import shutil
import zlib
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from called import run_command
from cuboid.cli import report as command
from cuboid.ground.core.errors import FrameError, InputError, OutputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.palette import color_of, hex_of
from cuboid.ground.core.results import MapPoints
from cuboid.inputs.readers import open_recording
from cuboid.results.files import Results, read_tracks
from cuboid.results.views.report import Summary, page_of, summarise, write_report
from cuboid.results.views.report.page import SCRIPTS
from cuboid.results.views.report.pictures import (
    ASPECT,
    MAX_STRIP_PICTURES,
    STRIP,
    STRIP_WIDTH_PX,
    best_sightings,
    through_time,
    window,
)
from cuboid.results.views.report.points import OBJECTS_FRACTION, PackedPoints, morton, pack_points, thinned
from cuboid.results.views.report.summary import spans
from made_crowd import write_crowd
from made_results import BEST, COLORS, FRAMES, SEEN, SKIPPED, SPANS, map_points, write_results


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_results(tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def summary(results: Path) -> Summary:
    return summarise(Results(results), open_recording(results.parent / "recording").read)


def unpacked(packed: PackedPoints) -> dict[str, npt.NDArray[np.float64]]:
    """Read packed points as the page's script does."""
    columns = np.frombuffer(zlib.decompress(packed.content), np.uint8).reshape(12, packed.count).astype(np.int64)
    wide = [np.cumsum(columns[k] | columns[k + 1] << 8) % 65536 for k in (0, 2, 4, 10)]
    narrow = [np.cumsum(columns[k]) % 256 for k in (6, 7, 8, 9)]
    xyz = packed.low + packed.step_m * np.column_stack(wide[:3])
    return {"xyz": xyz, "rgb": np.column_stack(narrow[:3]), "heat": narrow[3] / 255.0, "label": wide[3]}


def test_packed_points_are_the_maps_to_half_a_step() -> None:
    points = map_points()
    packed = pack_points(points)
    found = unpacked(packed)
    assert (packed.count, packed.total) == (len(points.xyz),) * 2
    order = np.lexsort(np.round(points.xyz.T, 3))
    there = np.lexsort(np.round(found["xyz"].T, 3))
    np.testing.assert_allclose(found["xyz"].min(0), points.xyz.min(0), atol=1e-6)
    for name in ("rgb", "label"):
        values = np.unique(np.column_stack((np.round(points.xyz, 2)[order], getattr(points, name)[order])), axis=0)
        same = np.unique(np.column_stack((np.round(found["xyz"], 2)[there], found[name][there])), axis=0)
        assert len(values) == len(same)
    distance = np.linalg.norm(found["xyz"][:, None] - points.xyz[None, ::37], axis=2)
    nearest = distance.argmin(axis=0)
    assert distance.min(axis=0).max() <= packed.step_m * np.sqrt(3) / 2 + 1e-6
    np.testing.assert_array_equal(found["rgb"][nearest], points.rgb[::37])
    np.testing.assert_array_equal(found["label"][nearest], points.label[::37])
    np.testing.assert_allclose(found["heat"][nearest], points.heat[::37], atol=0.002)


def test_a_large_scene_has_larger_steps_and_an_empty_one_is_no_fault() -> None:
    xyz = np.array([[0, 0, 0], [1000, 5, 5], [500, 1, 1]], np.float32)
    far = pack_points(MapPoints(xyz, np.zeros((3, 3), np.uint8), np.zeros(3, np.float32), np.zeros(3, np.int32)))
    assert np.abs(np.sort(unpacked(far)["xyz"][:, 0]) - (0, 500, 1000)).max() <= far.step_m / 2 + 1e-6
    none = MapPoints(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))
    assert pack_points(none).count == 0


@given(arrays(np.int32, st.integers(0, 200), elements=st.integers(0, 2)), st.integers(1, 120))
def test_thinning_keeps_as_many_as_it_may_and_favours_objects(label: npt.NDArray[np.int32], most: int) -> None:
    kept = thinned(label, most)
    assert len(kept) == min(len(label), most)
    assert (np.diff(kept) > 0).all()
    own = (label > 0).sum()
    assert (label[kept] > 0).sum() >= min(own, round(most * OBJECTS_FRACTION))


@given(arrays(np.uint16, (5, 3)))
def test_the_order_of_points_interleaves_the_bits_of_their_places(cells: npt.NDArray[np.uint16]) -> None:
    for cell, code in zip(cells, morton(cells), strict=True):
        bits = [(int(cell[axis]) >> k & 1) << (3 * k + axis) for k in range(16) for axis in range(3)]
        assert sum(bits) == int(code)


def test_a_million_points_fit_a_page() -> None:
    rng = np.random.default_rng(0)
    xyz = np.round(rng.uniform(-3, 3, (1_000_000, 3)), 2).astype(np.float32)
    rgb = rng.integers(0, 256, (1_000_000, 3)).astype(np.uint8)  # as bad as colors can be
    points = MapPoints(
        xyz, rgb, rng.uniform(size=1_000_000).astype(np.float32), rng.integers(0, 9, 1_000_000, np.int32)
    )
    packed = pack_points(points)
    assert (packed.count, packed.total) == (400_000, 1_000_000)
    assert len(packed.content) * 4 / 3 < 8e6


def test_spans_are_the_runs_of_used_frames_that_see_a_label(results: Path, summary: Summary) -> None:
    assert spans(read_tracks(results / "tracks.csv"), summary.frames) == SPANS


def test_the_document_tells_what_the_files_tell(summary: Summary) -> None:
    told = summary.to_dict()
    assert [item["label"] for item in told["objects"]] == [1, 2, 3]
    assert [(item["label"], item["into"], item["spans"]) for item in told["gone"]] == [
        (4, 1, [(10, 12)]),
        (5, None, [(15, 15)]),
    ]
    first = told["objects"][0]
    assert (first["center"], first["size"], first["first_frame"]) == ([-0.3, 0.0, 0.15], [0.2, 0.1, 0.3], 2)
    assert first["color"] == hex_of(1)
    frames = np.frombuffer(base64.b64decode(told["frames"]), "<i4")
    assert list(frames) == [frame for frame in range(FRAMES) if frame not in SKIPPED]
    poses = np.frombuffer(base64.b64decode(told["poses"]), "<f4").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses[-1], summary.poses[-1].T_world_camera[:3], atol=1e-6)
    assert told["skipped"] == [[7, 2, SKIPPED[7]]]


def test_pictures_are_cut_from_the_frames_that_show_most(summary: Summary) -> None:
    assert {label: picture.frame for label, picture in summary.pictures.items()} == BEST
    for label, picture in summary.pictures.items():
        shown = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None
        assert abs(shown.shape[1] / shown.shape[0] - ASPECT) < 0.05
        assert np.abs(shown.reshape(-1, 3).mean(axis=0) - (200, 100, BEST[label])).max() < 3


def test_pictures_through_time_are_few_small_and_of_frames_that_see_the_object(summary: Summary) -> None:
    assert set(summary.strips) == set(COLORS)
    for label, strip in summary.strips.items():
        frames = [frame for frame, _ in strip]
        assert frames == sorted(set(frames))
        assert set(frames) <= set(SEEN[label])
        assert len(frames) == min(STRIP, len(SEEN[label]))
        for _, jpeg in strip:
            assert len(jpeg) < 8_000
            width = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).shape[1]  # type: ignore[union-attr]
            assert width <= STRIP_WIDTH_PX
    halves = [frame > 25 for frame, _ in summary.strips[1]]
    assert {True, False} == set(halves)  # from before and after it was hidden
    document = {item["label"]: item["strip"] for item in summary.to_dict()["objects"]}
    assert [shot["frame"] for shot in document[2]] == [frame for frame, _ in summary.strips[2]]


def test_a_page_of_many_objects_has_a_bounded_number_of_pictures_through_time(results: Path) -> None:
    rows = [row for row in read_tracks(results / "tracks.csv") if row.label == 2]
    many = [dataclasses.replace(row, label=label) for row in rows for label in range(1, 101)]
    chosen = through_time(many, range(1, 101), best_sightings(many))
    assert sum(map(len, chosen.values())) <= MAX_STRIP_PICTURES
    assert all(chosen.values())
    assert len({row.frame for found in chosen.values() for row in found}) <= 2  # frames are shared


def test_a_picture_shows_the_rectangle_and_what_is_around_it() -> None:
    color = np.zeros((100, 200, 3), np.uint8)
    x0, y0, x1, y1 = window(color, np.array([90.0, 40.0, 110.0, 60.0]))
    assert y1 - y0 == 30
    assert abs(x1 - x0 - 45) <= 1
    assert x0 < 90 < 110 < x1
    assert y0 < 40 < 60 < y1
    x0, y0, x1, y1 = window(color, np.array([0.0, 0.0, 10.0, 10.0]))
    assert (x0, y0, y1) == (0, 0, 15)
    assert window(color, np.array([0.0, 0.0, 200.0, 100.0])) == (0, 0, 200, 100)


def test_a_picture_has_the_outline_of_its_object(tmp_path: Path) -> None:
    folder = write_crowd(tmp_path, 2)  # side by side: none hides the other
    summary = summarise(Results(folder), open_recording(tmp_path / "recording").read)
    for label, picture in summary.pictures.items():
        shown = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None
        assert picture.size == shown.shape[1::-1]
        own = np.abs(shown[..., ::-1].astype(int) - color_of(label)).max(axis=2) < 40
        y, x = np.nonzero(own)
        ends = picture.edges.reshape(-1, 2)
        assert len(picture.edges) in (7, 9)  # of two or three faces that look at the camera
        np.testing.assert_allclose(ends.min(axis=0), (x.min(), y.min()), atol=3)
        np.testing.assert_allclose(ends.max(axis=0), (x.max(), y.max()), atol=3)


def test_what_cannot_be_read_is_left_without_a_picture(results: Path) -> None:
    def read(index: int) -> Frame:
        raise FrameError(f"{index}: truncated")

    assert summarise(Results(results), read).pictures == {}


def test_the_page_is_one_file_that_asks_for_nothing_else(summary: Summary) -> None:
    page = page_of(summary)
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", page)
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)
    assert page.count("<script") == page.count("</script>") == 2
    document = json.loads(page.split('id="data">')[1].split("</script>")[0])
    assert "<b>fuse" in document["run"]["milliseconds"]  # and no element of that name


def test_every_script_is_in_the_page() -> None:
    import cuboid.results.views.report

    folder = Path(cuboid.results.views.report.__file__).parent / "page"
    assert sorted(SCRIPTS) == sorted(path.name for path in folder.glob("*.js"))


def test_the_page_is_the_same_bytes_again_and_nothing_partial_is_left(summary: Summary, tmp_path: Path) -> None:
    for name in ("a.html", "b.html"):
        write_report(tmp_path / name, summary)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(tmp_path / "missing" / "c.html", summary)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.html", "b.html"]


def test_the_command_writes_the_page_of_finished_results(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(command, results, "--output", tmp_path / "with.html") == 0
    assert capsys.readouterr().out == f"page with 3 objects in {tmp_path / 'with.html'}\n"
    assert run_command(command, results, "--output", tmp_path / "without.html", "--no-pictures") == 0
    pages = [(tmp_path / name).read_text().count("data:image/jpeg") for name in ("with.html", "without.html")]
    assert pages == [3 + 6 + 6 + 2, 0]  # the best picture of each object, and those through time


def test_results_that_do_not_fit_are_one_line(results: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(results, broken)
    lines = (broken / "trajectory.txt").read_text().splitlines(keepends=True)
    (broken / "trajectory.txt").write_text("".join(lines[:-1]))
    with pytest.raises(InputError, match=r"trajectory\.txt: expected 38 lines, one a used frame of run\.json, got 37"):
        run_command(command, broken, "--no-pictures")
    with pytest.raises(InputError, match="expected a folder with the results"):
        run_command(command, tmp_path / "nothing")
    with pytest.raises(InputError, match=r"must end with \.html"):
        run_command(command, results, "--output", tmp_path / "page.pdf")
    (broken / "trajectory.txt").write_text("".join(lines))
    rows = (broken / "tracks.csv").read_text()
    (broken / "tracks.csv").write_text(rows + rows.splitlines()[1].replace("2,", "99,", 1) + "\n")
    with pytest.raises(InputError, match="frame 99 is not among the used frames"):
        run_command(command, broken, "--no-pictures")
