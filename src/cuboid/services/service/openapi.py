"""What the HTTP API of a place is, as an OpenAPI 3.1 document, made of the table of endpoints."""

from __future__ import annotations

import re
from typing import Any

import msgspec

from cuboid.services.queries.api import openapi_document, path_parameters, query_parameters
from cuboid.services.service.endpoints import ENDPOINTS, JSON, Endpoint

SOCKET = "/api/changes/live"
DESCRIPTION = (
    "Read-only. Lengths are metres, in the world of the place; times are UTC, ISO 8601. "
    f"The WebSocket {SOCKET} sends each change as JSON, a message each; `?after=N` begins with those after number N."
)
_WRONG = {
    "description": "what is wrong with the question, in one line",
    "content": {JSON: {"schema": {"type": "object"}}},
}


def openapi(*, secured: bool) -> dict[str, Any]:
    """Return the document."""
    kinds = [one.kind for one in ENDPOINTS if not isinstance(one.kind, str)]
    schemas, components = msgspec.json.schema_components(kinds, ref_template="#/components/schemas/{name}")
    schema_of = dict(zip((one.path for one in ENDPOINTS if not isinstance(one.kind, str)), schemas, strict=True))
    paths = {one.path: _operation(one, schema_of.get(one.path)) for one in ENDPOINTS}
    return openapi_document("Cuboid place", DESCRIPTION, paths, components, secured=secured)


def _operation(one: Endpoint, schema: Any) -> dict[str, Any]:
    body = {"type": "string", "format": "binary"} if schema is None else schema
    return {
        "summary": one.what,
        "operationId": re.sub(r"\W+", "_", one.path.removeprefix("/api")).strip("_") or "about",
        "parameters": [*path_parameters(one.path), *query_parameters(one.parameters)],
        "responses": {
            "200": {"description": one.what, "content": {one.media: {"schema": body}}},
            "400": _WRONG,
            "404": {"description": "there is none"},
        },
    }
