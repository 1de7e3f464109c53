"""The page with the frames' pictures beside it, served to the browser of this machine."""

from __future__ import annotations

import re
import threading
from functools import cached_property
from pathlib import Path
from urllib.parse import parse_qs

from cuboid.core.errors import FrameError, InputError
from cuboid.core.frame import Frame
from cuboid.outputs import Results
from cuboid.readers import Recording
from cuboid.views.redraw import KINDS, Draw, drawer
from cuboid.views.replay import Replay, ReplayedFrame
from cuboid.views.report.page import page_of
from cuboid.views.report.pictures import encode_jpeg
from cuboid.views.report.summary import summarise
from cuboid.views.serving import Answer, PageHandler, PageServer, listening_at, path_and_query

PICTURES = "/frame"
PICTURE = re.compile(rf"{PICTURES}/(\d{{1,9}})\.jpg")

# Encoded in 3 ms at 640x480; no block shows.
QUALITY = 90


class Viewer:
    """A finished run as a page and as pictures of its frames.

    Parameters
    ----------
    folder : Path
        What `cuboid track` left behind.
    replay : Replay
        Of that folder.
    recording : Recording
        That it is of.

    Raises
    ------
    InputError
        The results have no frame of this recording.
    """

    def __init__(self, folder: Path, replay: Replay, recording: Recording) -> None:
        self._folder = folder
        self._replay = replay
        self._recording = recording.without_poses()  # those of the results count
        self._drawers: dict[str, Draw] = {}
        self._lock = threading.Lock()  # a browser asks for several things at once
        self._frames: dict[int, ReplayedFrame] = {
            found.index: found for found in replay.frames(self._recording.timestamp_s)
        }
        if not self._frames:
            raise InputError(f"{folder}: no frame of {recording.path} is in its trajectory")

    @cached_property
    def page(self) -> bytes:
        """The page, UTF-8."""
        summary = summarise(Results(self._folder), self._recording.read)
        return page_of(summary, {"pictures": PICTURES, "kinds": KINDS}).encode("utf-8")

    def picture(self, index: int, what: str) -> bytes | None:
        """Return a frame with its objects drawn into it, as JPEG; None where there is no such picture.

        Parameters
        ----------
        index : int
            Of the recording.
        what : str
            One of `KINDS`.
        """
        with self._lock:
            found = self._frames.get(index)
            if found is None or what not in KINDS:
                return None
            if what not in self._drawers:
                self._drawers[what] = drawer(what, self._folder, self._replay)
            try:
                frame: Frame = self._recording.read(index)
            except FrameError:
                return None
            return encode_jpeg(self._drawers[what](frame, found), QUALITY)


def make_server(viewer: Viewer, port: int = 0) -> PageServer:
    """Return a server of the page on this machine's own address; `serve_forever` starts it.

    Parameters
    ----------
    viewer : Viewer
        What it shows.
    port : int
        0 takes one that is free.

    Raises
    ------
    OutputError
        The port is taken.
    """

    class Handler(PageHandler):
        show = staticmethod(lambda address: _answer(viewer, address))

    return listening_at(port, Handler)


def _answer(viewer: Viewer, address: str) -> Answer | None:
    """Return kind and content of what lies at an address; None where nothing does."""
    path, query = path_and_query(address)
    if path == "/":
        return "text/html; charset=utf-8", viewer.page
    asked = PICTURE.fullmatch(path)
    what = parse_qs(query).get("what", ["boxes"])[0]
    picture = viewer.picture(int(asked[1]), what) if asked else None
    return None if picture is None else ("image/jpeg", picture)
