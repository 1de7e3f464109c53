from __future__ import annotations

import threading
import time

import pytest

from cuboid.ground.core.frame import SkippedFrame
from cuboid.inputs.readers import open_recording
from cuboid.inputs.readers.prefetch import run_ahead


def decoders():
    return [thread for thread in threading.enumerate() if thread.name == "cuboid-decode"]


@pytest.mark.parametrize("prefetch", [True, False])
def test_every_and_limit(plain, prefetch):
    plain.depth(2).write_bytes(b"")
    recording = open_recording(plain.path)
    indices = [item.index for item in recording.iterate(every=2, prefetch=prefetch)]
    assert indices == [0, 2, 4]
    items = list(recording.iterate(every=2, limit=2, prefetch=prefetch))
    assert [item.index for item in items] == [0, 2]
    assert isinstance(items[1], SkippedFrame)
    assert list(recording.iterate(limit=0, prefetch=prefetch)) == []
    assert not decoders()


def test_nonsense_is_refused(plain):
    recording = open_recording(plain.path)
    with pytest.raises(ValueError, match="every must be at least 1"):
        next(recording.iterate(every=0))
    with pytest.raises(IndexError, match="frame 5 of a recording with 5 frames"):
        recording.read(5)


def test_frames_are_decoded_when_asked_for(plain, monkeypatch):
    recording = open_recording(plain.path)
    decoded = []
    read = type(recording).read
    monkeypatch.setattr(type(recording), "read", lambda self, k: decoded.append(k) or read(self, k))
    frames = recording.iterate(prefetch=False)
    next(frames)
    assert decoded == [0]


def test_a_consumer_who_stops_leaves_no_thread(plain):
    frames = open_recording(plain.path).iterate()
    assert next(frames).index == 0
    frames.close()
    assert not decoders()


def test_running_ahead_is_bounded_and_in_order():
    made = []

    def items():
        for k in range(100):
            made.append(k)
            yield k

    ahead = run_ahead(items(), 2)
    assert next(ahead) == 0
    deadline = time.monotonic() + 5
    while len(made) < 3 and time.monotonic() < deadline:
        time.sleep(0.001)
    time.sleep(0.02)
    assert made == [0, 1, 2]  # one taken, two ahead of it
    assert list(ahead) == list(range(1, 100))
    assert not decoders()


def test_faults_of_the_program_reach_the_consumer():
    def items():
        yield 1
        raise ZeroDivisionError("a bug")

    ahead = run_ahead(items(), 2)
    assert next(ahead) == 1
    with pytest.raises(ZeroDivisionError, match="a bug"):
        next(ahead)
    assert not decoders()
