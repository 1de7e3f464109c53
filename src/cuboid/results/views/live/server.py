"""The live page and its messages, served to the browser."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Self

from cuboid.ground.core.errors import OutputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import MapPoints
from cuboid.results.views.live.messages import end_message, map_message, moment_message, page_of, spacing_of, warm_up
from cuboid.results.views.live.watch import LiveView, RateLimiter
from cuboid.results.views.serving import HOST, LOCAL_NAMES, Answer, listening, path_and_query

# The first port is the same in every run, so that a forwarded port can stay; if it is in use, one of the next is used.
PORT = 8765
PORTS = range(PORT, PORT + 20)

# A request waits this long for new data; then it is answered without data, and the page asks again.
POLL_TIMEOUT_S = 5.0

# The page waits this long for a first moment; without one it loads empty, and reloads when there is one.
FIRST_MOMENT_S = 1.0

ASKED = re.compile(r"/(moment|map)/(\d{1,9})")
# The object with this label has its dimensions in the picture of the moment.
MEASURED = re.compile(r"measured=(\d{1,9})")


class LiveServer:
    """Context manager: serves a live view from separate threads.

    Parameters
    ----------
    view : LiveView
        The source of the data.
    title : str
        Title of the page.
    intrinsics : Intrinsics
        Of the recording's color image.
    host : str
        Address to listen on. With the loopback address, only this machine is served.

    Attributes
    ----------
    port : int

    Raises
    ------
    OutputError
        The address cannot be used.
    """

    def __init__(self, view: LiveView, title: str, intrinsics: Intrinsics, host: str = HOST) -> None:
        self.view = view
        self._title = title
        self._intrinsics = intrinsics
        self._spacing_m: float | None = None
        self._lock = threading.Lock()
        self._worker = ThreadPoolExecutor(1, "live view")  # one thread: each new thread would load the fonts
        self._packed: dict[tuple[str, int | None], tuple[int, bytes]] = {}
        try:
            names = LOCAL_NAMES if host in LOCAL_NAMES else ()
            self._server = listening(host, (*PORTS, 0), self._answer, names=names)
        except OSError as error:
            raise OutputError(f"--live: {host} cannot be used: {error.strerror or error}") from error
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, name="live view", daemon=True)

    def __enter__(self) -> Self:
        self._worker.submit(warm_up).result()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self.view.ended is None:
            self.view.end(complete=False)
        self._server.shutdown()
        self._server.server_close()
        self._worker.shutdown()

    def _answer(self, address: str) -> Answer | None:
        """Return content type and content for an address; None if there is no content."""
        path, query = path_and_query(address)
        if path == "/":
            moment = self.view.moment_after(0, FIRST_MOMENT_S)
            page = page_of(self._title, self._intrinsics, moment, self.view.first_pose)
            return "text/html; charset=utf-8", page.encode("utf-8", "backslashreplace")
        request = ASKED.fullmatch(path)
        if request is None:
            return None
        if request[1] == "map":
            return self._map(int(request[2]))
        measured = MEASURED.fullmatch(query)
        return self._moment(int(request[2]), None if measured is None else int(measured[1]))

    def _moment(self, number: int, measured: int | None) -> Answer:
        moment = self.view.moment_after(number, POLL_TIMEOUT_S)
        if moment is not None:
            known = next((item.label for item in moment.objects if item.label == measured), None)
            return "application/json", self._once(
                self.view.moments,
                ("moment", known),
                moment.number,
                lambda: moment_message(moment, self._intrinsics, known),
            )
        ended = self.view.ended
        if ended is None:
            return "application/json", b"{}"
        self.view.farewell()
        return "application/json", end_message(ended, self.view.warnings)

    def _map(self, number: int) -> Answer:
        found = self.view.map_after(number, POLL_TIMEOUT_S)
        if found is None:
            return "application/octet-stream", b""
        return "application/octet-stream", self._once(
            self.view.maps, ("map", None), found[0], lambda: self._packed_map(*found)
        )

    def _packed_map(self, number: int, points: MapPoints) -> bytes:
        if self._spacing_m is None:
            self._spacing_m = spacing_of(points)
        return map_message(number, points, self._spacing_m or 0.01)

    def _once(self, limiter: RateLimiter, of: tuple[str, int | None], number: int, make: Callable[[], bytes]) -> bytes:
        """Return a message of a kind, with the dimensions of an object or without; it is built once for all clients."""
        with self._lock:
            if of not in self._packed or self._packed[of][0] < number:
                made = self._worker.submit(charged, limiter, make).result()
                self._packed = {key: kept for key, kept in self._packed.items() if key[0] != of[0] or kept[0] >= number}
                self._packed[of] = number, made
            return self._packed[of][1]


def charged(limiter: RateLimiter, make: Callable[[], bytes]) -> bytes:
    """Return the result of `make`, and charge its processor time to a limiter."""
    with limiter.charged():
        return make()
