"""The page with pictures of the frames, served to the browser of this machine."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import TrackedObject, names_of
from cuboid.inputs.readers import Recording
from cuboid.method.text_search import TextMatch
from cuboid.results.files import Results
from cuboid.results.files.naming import name_document
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.redraw import KINDS, Draw, drawer
from cuboid.results.views.replay import Replay, ReplayedFrame
from cuboid.results.views.report.page import page_of
from cuboid.results.views.report.summary import Summary, summarise
from cuboid.results.views.serving import Answer, PageServer, json_answer, listening_at, path_and_query

PICTURES = "/frame"
NAMES = "/names"
TEXT = "/text"
PICTURE = re.compile(rf"{PICTURES}/(\d{{1,9}})\.jpg")

# Encoding takes 3 ms at 640x480; no blocks are visible.
STREAM_QUALITY = 90


Rename = Callable[[int, str], TrackedObject]
# Ranks objects by a text.
FindByText = Callable[[str], Sequence[TextMatch]]


class Viewer:
    """A finished run as a page and as pictures of its frames.

    Parameters
    ----------
    folder : Path
        A result folder of `cuboid track`.
    replay : Replay
        Of that folder.
    recording : Recording or None
        The recording of the results; without it there are no pictures of frames.
    rename : callable, optional
        Stores the name of a label, and returns the named object (default: in the folder).
    summary : Summary, optional
        The contents of the page (default: those of the folder).
    find : callable, optional
        Ranks objects by a text; without it the page searches only by name, label and size.

    Raises
    ------
    InputError
        The results have no frame of this recording.
    """

    def __init__(
        self,
        folder: Path,
        replay: Replay,
        recording: Recording | None,
        rename: Rename | None = None,
        summary: Summary | None = None,
        find: FindByText | None = None,
    ) -> None:
        self._find = find
        self._folder = folder
        self._replay = replay
        self._rename = rename or Results(folder).name
        self._recording = None if recording is None else recording.without_poses()  # the poses of the results are used
        self._drawers: dict[str, Draw] = {}
        self._lock = threading.Lock()  # a browser sends several requests at once
        self._frames: dict[int, ReplayedFrame] = {}
        if self._recording is not None:
            self._frames = {found.index: found for found in replay.frames(self._recording.timestamp_s)}
        if recording is not None and not self._frames:
            raise InputError(f"{folder}: no frame of {recording.path} is in its trajectory")
        self._summary = summary or summarise(Results(folder), None if self._recording is None else self._recording.read)

    @property
    def page(self) -> bytes:
        """The page, UTF-8."""
        pictures = {} if self._recording is None else {"pictures": PICTURES, "kinds": KINDS}
        text = {} if self._find is None else {"text": TEXT}
        return page_of(self._summary, {"names": NAMES, **text, **pictures}).encode("utf-8")

    def fits(self, text: str) -> list[tuple[int, float]]:
        """Return the labels of objects with their similarity to a text, the best first; empty without a model.

        Raises
        ------
        InputError
            The text is empty, or there are no pictures of the objects.
        """
        with self._lock:
            found = [] if self._find is None else self._find(text)
        return [(item.label, round(score, 6)) for item, score in found]

    def rename(self, label: int, name: str) -> TrackedObject:
        """Name an object, or remove its name with an empty text; return the changed object.

        Raises
        ------
        InputError
            No object has the label, or the name is invalid.
        OutputError
            The name cannot be written.
        """
        with self._lock:
            named = self._rename(label, name)
            self._summary = self._summary.named(named)
            self._replay.names = names_of(self._summary.found.objects)
            return named

    def picture(self, index: int, kind: str, least: float = 0.0) -> bytes | None:
        """Return a frame with its objects drawn into it, as JPEG; None if there is no such picture.

        Parameters
        ----------
        index : int
            Frame of the recording.
        kind : str
            One of `KINDS`.
        least : float
            Leave out objects with a lower probability, and those that are no longer in the map; 0: none.
        """
        with self._lock:
            found = self._frames.get(index)
            if found is None or self._recording is None or kind not in KINDS:
                return None
            if least > 0.0:
                found = found.only({item.label for item in self._summary.found.objects if item.probability >= least})
            if kind not in self._drawers:
                self._drawers[kind] = drawer(kind, self._folder, self._replay)
            try:
                frame: Frame = self._recording.read(index)
            except FrameError:
                return None
            return encode_jpeg(self._drawers[kind](frame, found), STREAM_QUALITY)


def make_server(viewer: Viewer, port: int = 0) -> PageServer:
    """Return a server of the page on the loopback address; `serve_forever` starts it.

    Parameters
    ----------
    viewer : Viewer
        The contents of the page.
    port : int
        0 chooses a free port.

    Raises
    ------
    OutputError
        The port is in use.
    """
    return listening_at(port, partial(_answer, viewer), partial(_take, viewer))


def _answer(viewer: Viewer, address: str) -> Answer | None:
    """Return content type and content for an address; None if there is no content."""
    path, query = path_and_query(address)
    if path == "/":
        return "text/html; charset=utf-8", viewer.page
    request = PICTURE.fullmatch(path)
    asked = parse_qs(query)
    try:
        least = float(asked.get("least", ["0"])[0])
    except ValueError:
        return None
    picture = viewer.picture(int(request[1]), asked.get("what", ["boxes"])[0], least) if request else None
    return None if picture is None else ("image/jpeg", picture)


def _take(viewer: Viewer, address: str, content: bytes) -> Answer | None:
    """Answer, in JSON, a request to store a name or to rank objects by a text; None at other addresses."""
    answers: dict[str, Callable[[dict[str, Any]], Any]] = {
        NAMES: lambda sent: name_document(viewer.rename(int(sent["label"]), str(sent["name"]))),
        TEXT: lambda sent: {"objects": viewer.fits(str(sent["text"]))},
    }
    answer = answers.get(path_and_query(address)[0])
    return None if answer is None else json_answer(answer, content)
