from __future__ import annotations

import contextlib
import resource
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.video.reformatter import VideoReformatter

from cuboid.ground.arrays import UInt8Array
from cuboid.ground.core.errors import OutputError
from cuboid.results.views.encoding import GIF_FRAMES, GIF_WIDTH_PX, GifWriter, Mp4Writer, VideoWriter, yuv420


def pictures(count: int, height: int = 48, width: int = 64) -> list[UInt8Array]:
    """A bright square that moves over a dark gradient."""
    ground = np.linspace(20, 90, width, dtype=np.uint8)
    out = []
    for i in range(count):
        picture = np.repeat(np.broadcast_to(ground, (height, width))[..., None], 3, axis=2).copy()
        picture[8:24, 4 + i % 20 : 20 + i % 20] = (240, 120, 30)
        out.append(picture)
    return out


def write(writer: VideoWriter, frames: Iterable[UInt8Array]) -> None:
    with writer:
        for picture in frames:
            writer.add(picture)


def decode(path: Path) -> list[UInt8Array]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def open_files() -> list[str]:
    """Return the paths of the files that this process has open."""
    found = []
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):  # the folder itself, which is closed
            found.append(str(entry.readlink()))
    return found


def boxes_of(path: Path) -> list[str]:
    """Return the names of the top-level boxes of an MP4."""
    content, at, names = path.read_bytes(), 0, []
    while at < len(content):
        names.append(content[at + 4 : at + 8].decode("ascii"))
        at += int.from_bytes(content[at : at + 4], "big")
    return names


def test_planes_are_those_of_swscale() -> None:
    coarse = np.random.default_rng(2).integers(0, 256, (12, 16, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, (64, 48), interpolation=cv2.INTER_LINEAR)
    picture[20:28, 30:32] = (255, 0, 0)  # a thin colored line
    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
    truth = VideoReformatter().reformat(frame, format="yuv420p", interpolation="AREA").to_ndarray()
    found = yuv420(np.asarray(picture, np.uint8))
    assert np.abs(found.astype(int) - truth).max() <= 2


def test_an_mp4_is_what_browsers_play(tmp_path: Path) -> None:
    path, frames = tmp_path / "a.mp4", pictures(70)
    write(Mp4Writer(path, 30.0), frames)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec.name, stream.format.name, stream.width, stream.height) == (
            "h264",
            "yuv420p",
            64,
            48,
        )
        assert (stream.average_rate, stream.frames) == (30, 70)
        times_s = [packet.pts * float(packet.time_base) for packet in container.demux(stream) if packet.size]
        keys = [packet.is_keyframe for packet in av.open(str(path)).demux(video=0) if packet.size]
    np.testing.assert_allclose(sorted(times_s), np.arange(70) / 30.0, atol=1e-4)
    assert sum(keys) >= 2  # one can jump into it
    names = boxes_of(path)
    assert names.index("moov") < names.index("mdat")
    shown = decode(path)
    errors = [np.abs(a.astype(int) - b).mean() for a, b in zip(shown, frames, strict=True)]
    assert max(errors) < 6
    assert np.abs(shown[40][12:20, 8:18].mean(axis=(0, 1)) - (240, 120, 30)).max() < 30  # red is red


@pytest.mark.parametrize("shape", [(47, 64), (48, 63), (47, 63)])
def test_odd_sizes_get_one_more_row_or_column(tmp_path: Path, shape: tuple[int, int]) -> None:
    path, frames = tmp_path / "a.mp4", pictures(5, *shape)
    write(Mp4Writer(path, 12.5), frames)
    shown = decode(path)
    assert shown[0].shape == (48, 64, 3)
    assert np.abs(shown[4][: shape[0], : shape[1]].astype(int) - frames[4]).mean() < 6


@pytest.mark.parametrize(
    ("name", "make"), [("a.mp4", lambda p: Mp4Writer(p, 30.0)), ("a.gif", lambda p: GifWriter(p, 20))]
)
class TestAnyWriter:
    def test_the_same_pictures_are_the_same_bytes(
        self, tmp_path: Path, name: str, make: Callable[[Path], VideoWriter]
    ) -> None:
        contents = []
        for folder in ("one", "two"):
            (tmp_path / folder).mkdir()
            write(make(tmp_path / folder / name), pictures(20))
            contents.append((tmp_path / folder / name).read_bytes())
        assert contents[0] == contents[1]

    def test_the_file_appears_only_when_it_is_whole(
        self, tmp_path: Path, name: str, make: Callable[[Path], VideoWriter]
    ) -> None:
        path = tmp_path / name
        path.write_bytes(b"old")
        with make(path) as writer:
            for picture in pictures(20):
                writer.add(picture)
            assert path.read_bytes() == b"old"
        assert len(decode(path)) == 20
        assert [entry.name for entry in tmp_path.iterdir()] == [name]

    def test_an_error_leaves_nothing(self, tmp_path: Path, name: str, make: Callable[[Path], VideoWriter]) -> None:
        def broken() -> Iterator[UInt8Array]:
            yield from pictures(3)
            raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            write(make(tmp_path / name), broken())
        assert list(tmp_path.iterdir()) == []

    def test_no_picture_no_file(self, tmp_path: Path, name: str, make: Callable[[Path], VideoWriter]) -> None:
        write(make(tmp_path / name), [])
        assert list(tmp_path.iterdir()) == []

    def test_a_folder_that_is_not_there_is_one_line(
        self, tmp_path: Path, name: str, make: Callable[[Path], VideoWriter]
    ) -> None:
        with pytest.raises(OutputError, match=rf"^.*missing/{name}: cannot be written: No such file.*$"):
            write(make(tmp_path / "missing" / name), pictures(3))

    def test_a_file_that_may_not_grow_is_one_line_and_leaves_nothing(
        self, tmp_path: Path, name: str, make: Callable[[Path], VideoWriter]
    ) -> None:
        noise = np.random.default_rng(0).integers(0, 256, (20, 240, 320, 3)).astype(np.uint8)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
        try:
            with pytest.raises(OutputError, match=rf"{name}: cannot be written") as raised:
                write(make(tmp_path / name), list(noise))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert "\n" not in str(raised.value)
        assert list(tmp_path.iterdir()) == []
        assert not [path for path in open_files() if path.startswith(str(tmp_path))]


@pytest.mark.parametrize("limit", [0, 40, 4096, 5000])
def test_no_file_stays_open_on_a_full_disk(tmp_path: Path, limit: int) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (4, 240, 320, 3)).astype(np.uint8)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        with pytest.raises(OutputError, match=r"a\.mp4: cannot be written"):
            write(Mp4Writer(tmp_path / "a.mp4", 30.0), list(noise))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not [path for path in open_files() if path.startswith(str(tmp_path))]


def test_a_gif_is_small_short_and_repeats(tmp_path: Path) -> None:
    path = tmp_path / "a.gif"
    write(GifWriter(path, 250), pictures(250, 300, 800))
    shown = decode(path)
    assert shown[0].shape == (GIF_WIDTH_PX * 300 // 800, GIF_WIDTH_PX, 3)
    assert len(shown) == 84  # each third
    assert len(shown) <= GIF_FRAMES
    assert b"NETSCAPE2.0" in path.read_bytes()
    with av.open(str(path)) as container:
        assert container.streams.video[0].average_rate == 12.5
    reds = [int((picture[..., 0] > 180).sum()) for picture in shown]
    assert min(reds) > 0.8 * 16 * 16 / 4  # the square keeps its color
