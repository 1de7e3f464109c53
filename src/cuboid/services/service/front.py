"""The start page of a served place: a search of its objects, which follows a run."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import PurePath

from cuboid.services.queries.cards import Card, answering
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.parameters import TEXT
from cuboid.services.queries.place import Place
from cuboid.services.queries.rows import row_of
from cuboid.services.queries.search_form import FIELDS, search_form
from cuboid.services.queries.search_page import Found, counted, page_html, searched
from cuboid.services.service.endpoints import ENDPOINTS, filters_in
from cuboid.services.service.openapi import SOCKET

# The 3D page of the place.
PAGE = "/report.html"


def front_page(place: Place, query: Mapping[str, str]) -> tuple[str, int]:
    """Return the page as HTML, and its HTTP status; its addresses are relative to it.

    Parameters
    ----------
    place : Place
    query : mapping
        Parameters of the request.
    """
    about, surfaces = place.about(), place.surface_words()
    asked = {name: value.strip() for name, value in query.items() if value.strip()}

    def find(question: str, also: Filters) -> Found:
        answer = place.ask(question, also.limit, also)
        standing = place.standing_on([one.label for one in answer.objects])
        shown_in = None if about.kind == "run" or about.running else PAGE[1:]
        cards = []
        for one in answer.objects:
            picture = f"api/objects/{one.label}/picture"
            page = f"{shown_in}#{one.label}" if shown_in else None
            card = Card(str(one.label), row_of(one, about.title), picture, page, standing.get(one.label))
            last = f"{picture}?last=true" if shown_in else None  # a run keeps the best pictures only
            cards.append(answering(card, last, answer.understood))
        return Found(answer.understood, cards, answer.note)

    found = searched(asked, lambda conditions: filters_in(place, conditions), find, place.without, surfaces)
    fields = FIELDS if place.model is None else (*FIELDS, TEXT)
    page = page_html(
        PurePath(about.title).name or about.title,
        about.title,
        counted(about.objects),
        found,
        running=about.running,
        form=search_form(asked, fields, surfaces, place.names()),
        below=_programs(),
        document={"socket": SOCKET[1:]},
    )
    return page, found.status


def _programs() -> str:
    """Return the list of addresses for programs, as HTML."""
    addresses = [(_address(one.path), one.what) for one in ENDPOINTS]
    addresses.append((f"<code>{SOCKET}</code>", "A WebSocket that sends each change of the map"))
    addresses.append((_address("/openapi.json"), "The description of this API (OpenAPI)"))
    lines = "".join(f"<li>{address} {escape(what)}</li>" for address, what in addresses)
    return f'<details class="programs"><summary>Addresses for programs</summary><ul>{lines}</ul></details>'


def _address(path: str) -> str:
    shown = f"<code>{escape(path)}</code>"
    return shown if "{" in path or path in ("/api/last-seen", "/api/ask") else f'<a href="{path[1:]}">{shown}</a>'
