"""A place over HTTP and a WebSocket, as an ASGI application."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.results.views.guard import POLICY_VIOLATION
from cuboid.results.views.serving import LOCAL_NAMES
from cuboid.services.queries.answers import MapChange
from cuboid.services.queries.api import guarded, refusal
from cuboid.services.queries.place import Place
from cuboid.services.queries.words import whole
from cuboid.services.service.endpoints import ENDPOINTS, JSON, Endpoint
from cuboid.services.service.front import PAGE, front_page
from cuboid.services.service.openapi import SOCKET, openapi

# The map is compared with what it was this often, seconds: people and planners act more slowly.
REFRESH_S = 0.25
# Maximum number of changes that wait for one client; a slower client is disconnected, and may connect again.
WAITING_CHANGES = 256
# Close code: try again later.
TOO_SLOW = 1013


def application(place: Place, *, token: str | None, hosts: tuple[str, ...] = LOCAL_NAMES) -> Starlette:
    """Return the application.

    Parameters
    ----------
    place : Place
    token : str or None
        Token that a request must contain; with None every request is answered.
    hosts : tuple of str
        Names under which it is answered; ``*`` for any.
    """

    async def front(request: Request) -> Response:
        page, status = await run_in_threadpool(front_page, place, dict(request.query_params))
        return HTMLResponse(page, status)

    async def scene(request: Request) -> Response:
        page = await run_in_threadpool(place.page)
        return refusal("the 3D page is there when the run has ended", 404) if page is None else HTMLResponse(page)

    routes = [
        Route("/", front),
        Route(PAGE, scene),
        *(Route(one.path, partial(_answered, place, one)) for one in ENDPOINTS),
        WebSocketRoute(SOCKET, partial(_changes, place)),
    ]
    return guarded(routes, openapi(secured=token is not None), token, hosts, partial(_watching, place))


@asynccontextmanager
async def _watching(place: Place, app: Starlette) -> AsyncIterator[None]:
    """Compare the map with what it was, again and again, while the server runs."""

    async def watch() -> None:
        while True:
            with suppress(InputError):  # a file that is being replaced; each question tells what is wrong
                await run_in_threadpool(place.refresh)
            await asyncio.sleep(REFRESH_S)

    task = asyncio.create_task(watch())
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def _answered(place: Place, endpoint: Endpoint, request: Request) -> Response:
    return await run_in_threadpool(_answer, place, endpoint, dict(request.query_params), request.path_params)


def _answer(place: Place, endpoint: Endpoint, query: dict[str, str], path: dict[str, str]) -> Response:
    """Answer in a thread; what is wrong with the question is an answer as well."""
    unknown = sorted(set(query) - set(endpoint.parameters))
    try:
        if unknown:
            names = ", ".join(endpoint.parameters) or "none"
            raise InputError(f"unknown parameter '{unknown[0]}'; there are {names}")
        found = endpoint.answer(place, query | path)
    except InputError as error:
        return refusal(error, 404 if str(error).startswith("no object has") else 400)
    except MissingExtraError as error:
        return refusal(error, 501)
    if found is None:
        return refusal("there is none", 404)
    if endpoint.media == JSON:
        return Response(msgspec.json.encode(found), media_type=JSON)
    content, media = found if isinstance(found, tuple) else (found, endpoint.media)
    return Response(content, media_type=media)


async def _changes(place: Place, socket: WebSocket) -> None:
    """Send the changes to one client until it goes, or falls behind."""
    await socket.accept()
    try:
        after = whole(socket.query_params["after"]) if "after" in socket.query_params else None
    except ValueError as error:
        await socket.close(POLICY_VIOLATION, f"after: {error}")
        return
    waiting: asyncio.Queue[MapChange] = asyncio.Queue(WAITING_CHANGES)
    loop, slow = asyncio.get_running_loop(), asyncio.Event()

    def take(changes: Sequence[MapChange]) -> None:
        for one in changes:
            if waiting.full():
                slow.set()
                return
            waiting.put_nowait(one)

    def hear(changes: Sequence[MapChange]) -> None:
        loop.call_soon_threadsafe(take, changes)

    stop = place.changes.listen(hear)
    tasks = {
        asyncio.create_task(_send(socket, place, waiting, after)),
        asyncio.create_task(_until_gone(socket)),
        asyncio.create_task(slow.wait()),
    }
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            with suppress(WebSocketDisconnect):
                task.result()
    finally:
        stop()
        for task in tasks:
            task.cancel()
        if slow.is_set():
            with suppress(RuntimeError):  # it has gone
                await socket.close(TOO_SLOW, "too slow: ask again after the last change")


async def _send(socket: WebSocket, place: Place, waiting: asyncio.Queue[MapChange], after: int | None) -> None:
    last = 0
    for one in [] if after is None else place.changes.after(after):
        await socket.send_text(msgspec.json.encode(one).decode())
        last = one.number
    while True:
        one = await waiting.get()
        if one.number > last:
            await socket.send_text(msgspec.json.encode(one).decode())


async def _until_gone(socket: WebSocket) -> None:
    """Wait until the client closes; what it sends is not read on."""
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
