"""The process that answers about a run: it listens, takes updates, and ends with the run."""

from __future__ import annotations

import os
import pickle
import socket
import threading
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Self

from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult
from cuboid.runs.tracking.types import MapLike
from cuboid.services.service.feed import END, MapFeed

# Steps by which the answering process stands back where the processor is short: the tracker comes first.
NICE = 5
# How long the end of a run waits for its last update to be taken, then for the process to end, seconds.
END_S, LEAVE_S = 2.0, 5.0
# How long clients may still take the last changes, seconds.
LAST_CHANGES_S = 0.5
# Connections at once; more are refused.
MAX_CLIENTS = 256


class ServedRun:
    """Answers about a run from another process while it goes; a context manager, called after each used frame.

    Parameters
    ----------
    title : str
        Of the run.
    listening : socket.socket
        Where it listens.
    token : str or None
        What requests must carry.
    hosts : tuple of str
        Names under which it is answered.

    Attributes
    ----------
    feed : MapFeed
    """

    def __init__(self, title: str, listening: socket.socket, token: str | None, hosts: tuple[str, ...]) -> None:
        context = get_context("spawn")
        parent_end, child_end = context.Pipe()
        self._process = context.Process(
            target=answer_about_run, args=(child_end, listening, title, token, hosts), name="cuboid serve", daemon=True
        )
        self._process.start()
        child_end.close()
        listening.close()
        self.feed = MapFeed(parent_end)

    @property
    def pid(self) -> int | None:
        """The number of the process."""
        return self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.feed.end(END_S)
        self._process.join(LEAVE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def __call__(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        """Look at a run after a frame."""
        self.feed(frame, result, tracker)


def answer_about_run(
    connection: Connection, listening: socket.socket, title: str, token: str | None, hosts: tuple[str, ...]
) -> None:
    """Serve a run until its tracker ends: what runs in the process of its own."""
    with suppress(OSError):
        os.setpgrp()  # Ctrl-C is for the tracker, which tells when it has ended
    with suppress(OSError):
        os.nice(NICE)
    import uvicorn

    from cuboid.ground.core.threads import limit_threads
    from cuboid.services.queries.place import Place
    from cuboid.services.service.app import application
    from cuboid.services.service.live import RunSource

    limit_threads(1)
    source = RunSource(title, connection)
    place = Place(source)
    app = application(place, token=token, hosts=hosts)
    config = uvicorn.Config(
        app,
        log_level="warning",
        server_header=False,
        access_log=False,
        limit_concurrency=MAX_CLIENTS,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)

    def take_updates() -> None:
        with suppress(OSError, EOFError):
            while (content := connection.recv_bytes()) != END:
                place.changes.add_events(source.take(pickle.loads(content)))
        source.end()
        place.refresh()
        threading.Event().wait(LAST_CHANGES_S)
        server.should_exit = True

    threading.Thread(target=take_updates, name="updates", daemon=True).start()
    server.run(sockets=[listening])
