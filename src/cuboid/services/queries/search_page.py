"""The page of a search: the question and its conditions, what was understood, and the objects as cards."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any
from urllib.parse import quote, urlencode

from cuboid.ground.core.errors import InputError
from cuboid.results.views.report.page import assembled
from cuboid.results.views.report.pictures import jpeg_address
from cuboid.services.queries.cards import Card, cards_html
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.parameters import MAX_ROWS, PARAMETERS, asked_of
from cuboid.services.queries.search_form import ASK

# Parameters of a field of the filters, where the names differ.
_NAMES = {
    "size_m": ("min_size", "max_size"),
    "inside": ("in",),
    "near": ("near", "within"),
    "near_object": ("near_object", "within"),
}


@dataclass(frozen=True, slots=True)
class Found:
    """The objects of a search.

    Attributes
    ----------
    understood : sequence of str
        The conditions of the question, in words.
    cards : sequence of Card
    note : str or None
        Why there are none, if a name is not known.
    """

    understood: Sequence[str]
    cards: Sequence[Card]
    note: str | None = None


@dataclass(frozen=True, slots=True)
class Searched:
    """The parts of a page with the objects of a search, as HTML, and its HTTP status."""

    answer: str
    cards: str
    status: int = 200


def searched(
    asked: Mapping[str, str],
    read: Callable[[Mapping[str, str]], Filters],
    find: Callable[[str, Filters], Found],
    without: Callable[[str, Filters], tuple[Filters, Mapping[str, int] | None]],
    surfaces: Mapping[str, str],
) -> Searched:
    """Return the parts of the page that answer a request; a mistake of the user is one line in them.

    Parameters
    ----------
    asked : mapping
        Parameters of the request that have a value.
    read : callable
        Returns the conditions of the parameters other than the question.
    find : callable
        Returns the objects for a question and conditions.
    without : callable
        Returns all conditions, and how many objects there are without each (`counts_without`); None for a question of
        where one object is.
    surfaces : mapping of str to str
        Surfaces in words, by the values of the parameter `on`.
    """
    question = asked.get(ASK, "")
    conditions = {name: value for name, value in asked.items() if name != ASK}
    try:
        filters = read(conditions)
        found = find(question, replace(filters, limit=filters.limit + 1))
        every: tuple[Filters, Mapping[str, int] | None] = (
            (filters, {}) if found.cards else without(question, replace(filters, limit=MAX_ROWS))
        )
    except InputError as error:
        fault = f'<p class="fault" role="alert">{escape(str(error))}</p>'
        return Searched(fault + _pills(asked, surfaces), cards_html(()) + _further(""), 400)
    cards, more = found.cards[: filters.limit], len(found.cards) > filters.limit
    said = ", ".join(f"<b>{escape(one)}</b>" for one in found.understood)
    parts = [f'<p class="said">Understood: {said}</p>' if said else "", _pills(asked, surfaces)]
    if cards:
        parts.append(f'<p class="count">{"The first " if more else ""}{counted(len(cards))}</p>')
    else:
        parts.append(_nothing(found.note, *every, conditions, surfaces))
    tried = "" if asked else "".join(_link({ASK: one}, one, "pill") for one in examples_of(cards))
    if tried:
        parts.append(f'<p class="try">Try: {tried}</p>')
    more = more and filters.limit < MAX_ROWS
    further = _link({**asked, "limit": str(min(2 * filters.limit, MAX_ROWS))}, "Show more") if more else ""
    return Searched("".join(parts), cards_html(cards) + _further(further))


def _nothing(
    note: str | None,
    filters: Filters,
    counts: Mapping[str, int] | None,
    asked: Mapping[str, str],
    surfaces: Mapping[str, str],
) -> str:
    """Return why there is no object, and how many there are without one of the conditions."""
    if note is not None:
        return f'<p class="empty">{escape(note)}</p>'
    every = asked_of(filters) | {name: asked[name] for name in ("text",) if name in asked}
    if not every:
        return '<p class="empty">There is no object yet.</p>'
    if counts is None:
        return f'<p class="empty loosen">No object matches. {_link({}, "Show all")}</p>'
    links = []
    for name, count in counts.items():
        dropped = [one for one in _NAMES.get(name, (name,)) if one in every]
        words = " and ".join(_words(one, every[one], surfaces) for one in dropped)
        rest = {one: value for one, value in every.items() if one not in dropped}
        links.append(f"{_link(rest, counted(count))} without “{escape(words)}”")
    loosen = f": {', '.join(links)}." if links else f", even without any one of the conditions. {_link({}, 'Show all')}"
    return f'<p class="empty loosen">No object matches{loosen}</p>'


def _pills(asked: Mapping[str, str], surfaces: Mapping[str, str]) -> str:
    """Return the conditions of the fields, each with a link to the page without it."""
    pills = []
    for name, value in asked.items():
        if name in PARAMETERS and name != "limit":
            dropped, words = _NAMES.get(name, (name,)), escape(_words(name, value, surfaces))
            rest = {one: asked[one] for one in asked if one not in dropped}
            pills.append(f'<a class="pill" href="{_address(rest)}" aria-label="Remove {words}">{words} ×</a>')
    return f"<p>{''.join(pills)}</p>" if pills else ""


def _words(name: str, value: str, surfaces: Mapping[str, str]) -> str:
    return f"{PARAMETERS[name].field} {surfaces.get(value, value) if name == 'on' else value}"


def _address(asked: Mapping[str, str]) -> str:
    return escape(f"?{urlencode(asked)}") if asked else "."


def _link(asked: Mapping[str, str], text: str, kind: str = "link") -> str:
    return f'<a class="{kind}" href="{_address(asked)}">{escape(text)}</a>'


def _further(link: str) -> str:
    return f'<p id="further" class="further">{link}</p>'


def counted(count: int, word: str = "object") -> str:
    """Return a number of things in words."""
    return f"{count:,} {word}{'' if count == 1 else 's'}"


def examples_of(cards: Sequence[Card]) -> list[str]:
    """Return questions that these objects answer."""
    found = []
    names = [card.row["name"] for card in cards if card.row.get("name") and card.row["name"].replace(" ", "").isalnum()]
    colors = [card.row["colors"][0] for card in cards if card.row["colors"]]
    found += [f"where is the {names[0].lower()}"] if names else []
    found += [f"the {colors[0]} things"] if colors else []
    kinds = [kind for kind in ("table", "floor") if any(f" {kind}" in (card.standing or "") for card in cards)]
    found += [f"what is on the {kinds[0]}"] if kinds else []
    return [*found, "larger than 20 cm"] if cards else []


def page_html(
    name: str,
    path: str,
    facts: str,
    searched: Searched,
    *,
    running: bool = False,
    links: Mapping[str, str] | None = None,
    form: str = "",
    below: str = "",
    document: Mapping[str, Any] | None = None,
) -> str:
    """Return the whole page as HTML.

    Parameters
    ----------
    name, path : str
        Name in the heading, and the whole path or URL, which the heading shows as a hint.
    facts : str
        One line beside the heading.
    searched : Searched
    running : bool
        Whether a run is active.
    links : mapping of str to str, optional
        Addresses of the pages by name; an empty address is this page.
    form, below : str
        HTML above and below the objects.
    document : mapping, optional
        Data of the script: `socket`, the address of the changes; `running`; `every_s`, seconds between two requests.
    """
    leads = "".join(
        f'<a href="{quote(address)}">{escape(text)}</a>' if address else f'<a aria-current="page">{escape(text)}</a>'
        for text, address in (links or {}).items()
    )
    content = {
        "name": escape(name),
        "path": escape(path),
        "facts": f'<span class="running">running, {escape(facts)}</span>' if running else escape(facts),
        "links": f"<nav>{leads}</nav>" if leads else "",
        "form": form,
        "answer": searched.answer,
        "main": searched.cards + below,
    }
    data = {"title": name, "running": running, **(document or {})}
    scripts = ["elements.js", "search.js"]
    return assembled("search.html", ["search.css"], scripts, data, content, package="cuboid.services.queries")


def found_page(rows: Sequence[Mapping[str, Any]], title: str) -> str:
    """Return found objects as a page in one file.

    Parameters
    ----------
    rows : sequence of mapping
        With the columns of `cuboid find` and `picture`.
    title : str
    """
    of_one = all(row["run"] is None for row in rows)
    cards = [
        Card(f"{row['run']}#{row['label']}", row, _inside(row), recording=None if of_one else row["recording"])
        for row in rows
    ]
    empty = "" if rows else '<p class="empty">No object matches.</p>'
    return page_html(title, title, counted(len(rows)), Searched(empty, cards_html(cards)))


def _inside(row: Mapping[str, Any]) -> str | None:
    """Return the picture of a row as a data URL."""
    picture = row.get("picture")
    return jpeg_address(picture) if picture else None
