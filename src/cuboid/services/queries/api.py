"""The parts that the ASGI applications of a place and of a store share: access, refusals, the OpenAPI document."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.version import __version__
from cuboid.results.views.guard import READING, Guard
from cuboid.services.queries.parameters import Parameter


def access(token: str | None, hosts: tuple[str, ...], methods: tuple[str, ...] = READING) -> list[Middleware]:
    """Return the checks of a request: its token, its method, and the name of the host."""
    return [
        Middleware(Guard, token=token, methods=methods),
        Middleware(TrustedHostMiddleware, allowed_hosts=list(hosts)),
    ]


def guarded(
    routes: Sequence[BaseRoute],
    described: Mapping[str, Any],
    token: str | None,
    hosts: tuple[str, ...],
    lifespan: Callable[[Starlette], Any] | None = None,
) -> Starlette:
    """Return an application with these routes and `/openapi.json`; a user's mistake is answered with 400.

    Parameters
    ----------
    routes : sequence of BaseRoute
    described : mapping
        The OpenAPI document.
    token : str or None
        Token that a request must contain; with None every request is answered.
    hosts : tuple of str
        Names under which it is answered; ``*`` for any.
    lifespan : callable, optional
        Asynchronous context manager around the life of the application.
    """

    async def document(request: Request) -> Response:
        return JSONResponse(described)

    return Starlette(
        routes=[*routes, Route("/openapi.json", document)],
        middleware=access(token, hosts),
        exception_handlers={InputError: _refused, HTTPException: _no_such_address},
        lifespan=lifespan,
    )


async def _refused(request: Request, error: Exception) -> Response:
    return refusal(error, 400)


async def _no_such_address(request: Request, error: Exception) -> Response:
    """Answer in JSON at an address that does not exist, or does not take the method."""
    assert isinstance(error, HTTPException)
    if error.status_code == 404:
        return refusal(f"there is no address {shown(request.url.path)}; /openapi.json lists those that exist", 404)
    return refusal(error.detail, error.status_code)


def refusal(error: object, status: int) -> Response:
    """Return the answer that says what is wrong, in one line."""
    return JSONResponse({"error": str(error)}, status)


def openapi_document(
    title: str, description: str, paths: Mapping[str, Any], schemas: Mapping[str, Any] | None = None, *, secured: bool
) -> dict[str, Any]:
    """Return an OpenAPI 3.1 document; `paths` are the operations of GET by path."""
    components: dict[str, Any] = {} if schemas is None else {"schemas": schemas}
    if secured:
        components["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    return {
        "openapi": "3.1.0",
        "info": {"title": title, "version": __version__, "description": description},
        "paths": {path: {"get": operation} for path, operation in paths.items()},
        **({"components": components} if components else {}),
        **({"security": [{"token": []}]} if secured else {}),
    }


def query_parameters(parameters: Mapping[str, Parameter]) -> list[dict[str, Any]]:
    """Return the parameters of a query as OpenAPI describes them."""
    return [
        {"name": name, "in": "query", "schema": one.schema, "description": one.meaning}
        for name, one in parameters.items()
    ]


def path_parameters(path: str) -> list[dict[str, Any]]:
    """Return the parts of an address in braces as OpenAPI describes them: names of recordings, and numbers."""
    whole = {"type": "integer", "minimum": 0}
    return [
        {"name": name, "in": "path", "required": True, "schema": {"type": "string"} if name == "recording" else whole}
        for name in re.findall(r"\{(\w+)\}", path)
    ]
