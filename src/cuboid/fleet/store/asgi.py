"""A server for a store, as an ASGI application: its pages and a read-only API."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from cuboid.fleet.store.find import ask as ask_store
from cuboid.fleet.store.find import find, last_seen, picture_of
from cuboid.fleet.store.folder import RESULTS, StoreFolder
from cuboid.fleet.store.page import MORE, RECORDINGS, WORST, objects_page, summary_page
from cuboid.fleet.store.query import SharedTables, Tables
from cuboid.fleet.store.summary import summarise_store
from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.formats.folder import OUTPUT_NAMES
from cuboid.method.text_search import TextModel
from cuboid.results.views.serving import LOCAL_NAMES
from cuboid.services.queries.api import guarded, openapi_document, path_parameters, query_parameters, refusal
from cuboid.services.queries.parameters import PARAMETERS, QUESTION, Parameter, filters_of, given
from cuboid.services.queries.rows import plain
from cuboid.services.queries.search_form import ASK

TYPES = {".html": "text/html", ".json": "application/json", ".csv": "text/csv", ".txt": "text/plain"}

WHAT = Parameter({"type": "string", "example": "mug"}, "label or name", "")
LAST = Parameter({"type": "boolean"}, "the picture of its last sighting instead of its best one", "")
# Addresses with their meaning and their parameters.
PATHS: dict[str, tuple[str, Mapping[str, Parameter]]] = {
    "/api/objects": ("Objects, as `cuboid find` finds them", PARAMETERS),
    "/api/objects/{recording}/{label}/picture": ("Picture of an object, JPEG", {"last": LAST}),
    "/api/last-seen": (
        "The last sighting of the objects with a label or name, over all recordings, the latest first",
        {"what": WHAT},
    ),
    "/api/ask": ("The answer to a question in English, with further conditions", {ASK: QUESTION, **PARAMETERS}),
    "/api/recordings": (
        "Recordings that are done, the worst first, with their quality indicators",
        {name: PARAMETERS[name] for name in ("recording", "limit")},
    ),
    "/api/failures": ("Recordings that are not done, by reason", {}),
}


def application(
    url: str, *, token: str | None, hosts: tuple[str, ...] = LOCAL_NAMES, model: TextModel | None = None
) -> Starlette:
    """Return the ASGI application of a store.

    Parameters
    ----------
    url : str
        URL of the store.
    token : str or None
        Token that a request must contain; with None every request is answered.
    hosts : tuple of str
        Host names for which requests are answered; ``*`` for any.
    model : TextModel, optional
        Model for text search, which ranks the objects.

    Raises
    ------
    InputError
        There is no store at the URL.
    """
    tables = SharedTables(url)

    def route(path: str, answer: Callable[[Tables, Request], Response]) -> Route:
        async def endpoint(request: Request) -> Response:
            return await run_in_threadpool(tables.ask, lambda of: answer(of, request))

        return Route(path, endpoint)

    def search(of: Tables, request: Request) -> Response:
        return HTMLResponse(*objects_page(of, dict(request.query_params), model))

    def summary(of: Tables, request: Request) -> Response:
        asked = given(request.query_params)
        return HTMLResponse(summary_page(summarise_store(of, WORST + MORE, asked.get("recording")), url, asked))

    def objects(of: Tables, request: Request) -> Response:
        return _rows("objects", find(of, filters_of(given(request.query_params), model)))

    def last(of: Tables, request: Request) -> Response:
        what = request.query_params.get("what", "").strip()
        if not what:
            raise InputError("what is needed: the label or the name of an object")
        return _rows("objects", last_seen(of, what))

    def asked(of: Tables, request: Request) -> Response:
        query = dict(request.query_params)
        question = query.pop(ASK, "").strip()
        if not question:
            raise InputError("q is needed: a question such as 'the blue bin beside the chair'")
        also = filters_of(given(query), model)
        understood, rows, note = ask_store(of, question, limit=also.limit, also=also)
        return JSONResponse({"understood": understood, "objects": [plain(row) for row in rows], "note": note})

    def picture(of: Tables, request: Request) -> Response:
        path, last = request.path_params, request.query_params.get("last", "").lower() in ("1", "true", "yes")
        found = picture_of(of, path["recording"], path["label"], last=last)
        return refusal("there is none", 404) if found is None else Response(found, media_type="image/jpeg")

    def recordings(of: Tables, request: Request) -> Response:
        filters = filters_of(given(request.query_params))
        return _rows("recordings", summarise_store(of, filters.limit, filters.recording).worst)

    async def file(request: Request) -> Response:
        return await run_in_threadpool(_file, url, request.path_params["path"])

    routes = [
        route("/", search),
        route(f"/{RECORDINGS}", summary),
        route("/api/objects", objects),
        route("/api/objects/{recording:path}/{label:int}/picture", picture),
        route("/api/ask", asked),
        route("/api/last-seen", last),
        route("/api/recordings", recordings),
        route("/api/failures", lambda of, _: _rows("failures", summarise_store(of, 1).failed)),
        Route(f"/{RESULTS}/{{path:path}}", file),
    ]
    return guarded(routes, openapi(secured=token is not None), token, hosts)


def openapi(*, secured: bool) -> dict[str, Any]:
    """Return the description of the API, as an OpenAPI 3.1 document."""
    wrong = {"description": "what is wrong with the question, in one line"}
    rows = {"application/json": {"schema": {"type": "object"}}}
    jpeg = {"image/jpeg": {"schema": {"type": "string", "format": "binary"}}}
    paths = {
        path: {
            "summary": what,
            "parameters": [*path_parameters(path), *query_parameters(parameters)],
            "responses": {
                "200": {"description": what, "content": jpeg if path.endswith("/picture") else rows},
                "400": wrong,
            },
        }
        for path, (what, parameters) in PATHS.items()
    }
    return openapi_document("Cuboid store", "Read-only.", paths, secured=secured)


def _rows(name: str, rows: list[dict[str, Any]]) -> Response:
    return JSONResponse({name: [plain(row) for row in rows]})


def _file(url: str, path: str) -> Response:
    """Return a file of a result folder; files elsewhere in the store, or outside it, are refused."""
    parts = path.split("/")
    if parts[-1] not in OUTPUT_NAMES or any(part in ("", ".", "..") or part.startswith(".") for part in parts):
        return refusal(f"there is no file {shown(path)} in the store", 404)
    try:
        content = StoreFolder(url).read(f"{RESULTS}/{path}")
    except (FileNotFoundError, InputError):
        return refusal(f"there is no file {shown(path)} in the store", 404)
    return Response(content, media_type=TYPES.get(Path(path).suffix, "application/octet-stream"))
