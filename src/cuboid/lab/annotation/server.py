"""The server of the annotation page, for browsers on this machine."""

from __future__ import annotations

import re
import threading
from http import HTTPStatus
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.palette import COLORS
from cuboid.inputs.readers.recording import Recording
from cuboid.inputs.readers.usable import usable_poses
from cuboid.lab.annotation.propagate import propagated
from cuboid.lab.annotation.store import KeyframesFile, Outdated
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.report.page import assembled
from cuboid.results.views.report.summary import label_colors
from cuboid.results.views.serving import (
    Answer,
    PageServer,
    Refusal,
    json_answer,
    listening_at,
    path_and_query,
)

# Scripts in the order of their dependencies; the shared ones are also used by the report.
SCRIPTS = (
    *("math.js", "elements.js", "controls.js"),
    *("keyframes.js", "saving.js", "pictures.js", "board.js", "card.js", "timeline.js", "annotate.js"),
)

PICTURE = re.compile(r"/frame/(\d{1,9})\.jpg")
# JPEG quality; high, because rectangles are drawn to pixel accuracy and need sharp edges.
ANNOTATION_JPEG_QUALITY = 95
# Maximum number of rectangles per propagation request, 0.2 s of work; a frame has some tens of objects.
MAX_RECTS = 1000


class Annotator:
    """Answers the page's requests for a recording and its keyframes.

    Parameters
    ----------
    recording : Recording
    keyframes : KeyframesFile
        Keyframes of the recording.
    every : int
        The page suggests each n-th frame.
    """

    def __init__(self, recording: Recording, keyframes: KeyframesFile, every: int) -> None:
        self._posed = recording
        self._recording = recording.without_poses()  # frames without a pose can be annotated too
        self._keyframes = keyframes
        self._every = every
        self._lock = threading.Lock()  # readers are not thread-safe; a browser requests several frames at once

    def show(self, address: str) -> Answer | None:
        """Return content type and content of an address; None if there is nothing."""
        path, _ = path_and_query(address)
        if path == "/":
            return "text/html; charset=utf-8", self._page().encode("utf-8")
        asked = PICTURE.fullmatch(path)
        return ("image/jpeg", self._picture(int(asked[1]))) if asked else None

    def take(self, address: str, content: bytes) -> Answer | None:
        """Handle a request to save or to propagate; return the JSON answer, or None for other addresses."""
        action = {"/keyframes": self._save, "/carry": self._propagate}.get(path_and_query(address)[0])
        if action is None:
            return None
        return json_answer(action, content)

    def _save(self, sent: dict[str, Any]) -> dict[str, Any]:
        try:
            return {"revision": self._keyframes.save(int(sent["revision"]), dict(sent["document"]))}
        except Outdated as error:
            raise Refusal(HTTPStatus.CONFLICT, str(error)) from error

    def _propagate(self, sent: dict[str, Any]) -> dict[str, Any]:
        rects = self._rects(sent["rects"])
        with self._lock:
            return {"rects": propagated(self._posed, int(sent["from"]), int(sent["to"]), rects)}

    def _rects(self, sent: list[Any]) -> list[Float64Array]:
        """Return rectangles as arrays (4,); raise Refusal for too many, ValueError for an invalid one."""
        if len(sent) > MAX_RECTS:
            raise Refusal(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MAX_RECTS} rectangles, got {len(sent)}"
            )
        rects = [np.array(rect, np.float64).reshape(4) for rect in sent]
        K = self._recording.intrinsics
        for x0, y0, x1, y1 in rects:
            if not (0 <= x0 <= x1 <= K.width and 0 <= y0 <= y1 <= K.height):
                raise ValueError(
                    f"expected rectangles within {K.width} x {K.height} pixels, got [{x0:g}, {y0:g}, {x1:g}, {y1:g}]"
                )
        return rects

    def _picture(self, index: int) -> bytes:
        """Return a frame's color image as JPEG."""
        with self._lock:
            try:
                return encode_jpeg(self._recording.read(index).color, ANNOTATION_JPEG_QUALITY)
            except (FrameError, IndexError) as error:
                raise Refusal(HTTPStatus.UNPROCESSABLE_ENTITY, str(error)) from error

    def _page(self) -> str:
        styles, package = ["page.css", "annotate.css"], "cuboid.lab.annotation"
        return assembled("annotate.html", styles, SCRIPTS, self._document(), package=package)

    def _document(self) -> dict[str, Any]:
        K = self._recording.intrinsics
        return {
            "title": self._recording.path.name,
            "place": self._recording.path.parent.name,
            "file": self._keyframes.path.name,
            "width": K.width,
            "height": K.height,
            "count": len(self._recording),
            "every": self._every,
            "poseless": self._poseless(),
            "files": [self._recording.color_name(index) for index in range(len(self._recording))],
            "colors": [label_colors(number) for number in range(1, COLORS + 1)],
            "revision": self._keyframes.revision,
            "keyframes": self._keyframes.document,
        }

    def _poseless(self) -> list[int]:
        """Return the frames without a usable pose, which a run with the recording's poses cannot use."""
        frames = range(len(self._posed)) if self._posed.has_poses else range(0)
        return sorted({*frames} - usable_poses(self._posed, frames).keys())


def make_server(annotator: Annotator, port: int = 0) -> PageServer:
    """Return a server of the page on the local address; `serve_forever` starts it.

    Parameters
    ----------
    annotator : Annotator
    port : int
        Port number; 0 selects a free port.

    Raises
    ------
    OutputError
        The port is taken.
    """
    return listening_at(port, annotator.show, annotator.take)
