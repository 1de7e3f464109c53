"""Access to the ASGI applications: a token for requests, and security headers for browsers."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable
from typing import Any
from urllib.parse import urlencode

from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from cuboid.results.views.serving import MAX_BODY_BYTES, headers

COOKIE = "cuboid-token"
# Methods that change nothing.
READING = ("GET", "HEAD")
# Close code for a client that may not open a WebSocket (RFC 6455: policy violation).
POLICY_VIOLATION = 1008


class Guard:
    """Accepts requests with the token, and sends the security headers of pages to browsers.

    WebSockets and requests other than GET are accepted only from programs and from pages of this server. A request
    whose body is larger than `MAX_BODY_BYTES`, or of unknown length, is refused before the body is read.

    Parameters
    ----------
    app : ASGIApp
    token : str or None
        With None, all requests are accepted.
    methods : tuple of str
        Accepted HTTP methods.
    """

    def __init__(self, app: ASGIApp, token: str | None, methods: tuple[str, ...] = READING) -> None:
        self._app, self._token, self._methods = app, token, methods

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse the request, or pass it to the application."""
        if scope["type"] == "websocket":
            await self._open_socket(scope, receive, send)
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        answer: Awaitable[None] | None = None
        if _too_large(request):
            large = f"expected a body of at most {MAX_BODY_BYTES} bytes, and its Content-Length"
            # the connection ends with the answer: the server would read the body to find the next request
            answer = PlainTextResponse(large, 413, {"Connection": "close"})(scope, receive, send)
        elif request.method not in self._methods:
            answer = PlainTextResponse("read-only", 405)(scope, receive, send)
        elif request.method not in READING and not _is_same_origin(request):
            answer = PlainTextResponse("requests of pages from other sites are refused", 403)(scope, receive, send)
        elif not self._knows(request):
            answer = PlainTextResponse("a token is needed", 401, {"WWW-Authenticate": "Bearer"})(scope, receive, send)
        elif "token" in request.query_params:
            answer = self._remember(request)(scope, receive, send)
        await (answer if answer is not None else self._app(scope, receive, _with_headers(send)))

    async def _open_socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        connection = HTTPConnection(scope)
        if _is_same_origin(connection) and self._knows(connection):
            await self._app(scope, receive, send)
        else:
            await WebSocket(scope, receive, send).close(POLICY_VIOLATION)

    def _knows(self, request: HTTPConnection) -> bool:
        if self._token is None:
            return True
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        given = (bearer, request.cookies.get(COOKIE, ""), request.query_params.get("token", ""))
        return any(hmac.compare_digest(token.encode(), self._token.encode()) for token in given)

    def _remember(self, request: Request) -> Response:
        """Store the token in a cookie, and redirect to the address without the token."""
        rest = [(name, value) for name, value in request.query_params.multi_items() if name != "token"]
        answer = RedirectResponse(request.url.path + (f"?{urlencode(rest)}" if rest else ""))
        if self._token is not None:
            answer.set_cookie(COOKIE, self._token, httponly=True, samesite="strict")
        return answer


def _too_large(request: Request) -> bool:
    """Return whether a request has a body that is too large, or does not tell its length."""
    length = request.headers.get("content-length", "0")
    known = length.isascii() and length.isdecimal() and len(length) < 10 and int(length) <= MAX_BODY_BYTES
    return "transfer-encoding" in request.headers or not known


def _is_same_origin(connection: HTTPConnection) -> bool:
    """Return whether the request comes from a page of this server, or from a program that is no page."""
    origin = connection.headers.get("origin")
    return origin is None or origin.partition("://")[2] == connection.headers.get("host", "")


def _with_headers(send: Send) -> Send:
    async def sending(message: Any) -> None:
        if message["type"] == "http.response.start":
            message["headers"] += [
                (name.lower().encode(), value.encode()) for name, value in headers(forms=True).items()
            ]
        await send(message)

    return sending
