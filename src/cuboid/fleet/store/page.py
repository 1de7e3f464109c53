"""Pages of a store: a search of the objects of all recordings, and the outcome of its recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote, urlencode

from cuboid.fleet.store.find import StoreObjects, ask, without
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.schema import ALL_OBJECTS, RUNS
from cuboid.fleet.store.summary import StoreSummary, summarise_store, totals_of
from cuboid.ground.core.results import Relation
from cuboid.ground.formats.folder import REPORT
from cuboid.method.text_search import TextModel
from cuboid.services.queries.cards import Card, answering
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.parameters import TEXT, filters_of, given
from cuboid.services.queries.search_form import FIELDS, search_form
from cuboid.services.queries.search_page import Found, Searched, counted, page_html, searched
from cuboid.services.queries.standing import standing_in_words

NAME = "index.html"
SURFACES = {"floor": "the floor", "table": "a table"}
# Addresses of the served pages.
SEARCH, RECORDINGS = ".", "recordings"
# Columns for cards, as SQL.
PAGE_COLUMNS = ("relations", "picture is not null as has_picture")
# Seconds after which a page asks again: a batch may add recordings.
ASK_AGAIN_S = 15

# Number of recordings on the page, the worst first, and of further ones; `cuboid sql` has all.
WORST, MORE = 10, 490

# The meanings of the indicators of a recording.
_FAULTS = {
    "overlapping": "inside another object by a third or more of the smaller box",
    "floating": "on no surface, and touching no other object",
    "brief": "seen in fewer than five frames",
}


def write_summary(store: str) -> None:
    """Write the summary page of a store into it.

    Raises
    ------
    InputError, OutputError
        The store cannot be read or written.
    """
    place = StoreFolder(store)
    place.put(NAME, summary_page(summarise_store(Tables(store), WORST + MORE), store).encode("utf-8", "replace"))


def objects_page(tables: Tables, query: Mapping[str, str], model: TextModel | None = None) -> tuple[str, int]:
    """Return the page that searches the objects of all recordings, and its HTTP status.

    Parameters
    ----------
    tables : Tables
    query : mapping
        Parameters of the request.
    model : TextModel, optional
        Model for text search.
    """
    asked = {name: value.strip() for name, value in query.items() if value.strip()}

    def find(question: str, also: Filters) -> Found:
        answer = ask(tables, question, limit=also.limit, more=PAGE_COLUMNS, also=also)
        return Found(answer.understood, _cards(tables, answer.rows, answer.understood), answer.note)

    found = searched(
        asked,
        lambda conditions: filters_of(given(conditions), model),
        find,
        lambda question, also: without(tables, question, also),
        SURFACES,
    )
    fields = ("recording", *FIELDS) if model is None else ("recording", *FIELDS, TEXT)
    totals = totals_of(tables)
    page = page_html(
        _name_of(tables.url),
        tables.url,
        f"{counted(totals['objects'])} in {counted(totals['recordings'], 'recording')}",
        found,
        links={"Objects": "", "Recordings": RECORDINGS},
        form=search_form(asked, fields, SURFACES, StoreObjects(tables).names()),
        document={"every_s": ASK_AGAIN_S},
    )
    return page, found.status


def _cards(tables: Tables, rows: Sequence[Mapping[str, Any]], understood: Sequence[str]) -> list[Card]:
    """Return rows as cards, each with links to the page of its recording and to similar objects."""
    runs = sorted({row["run"] for row in rows})
    of_runs = "where run in (select unnest(?))"
    results = {one["run"]: one["results"] for one in tables.rows(f"select run, results from {RUNS} {of_runs}", [runs])}
    named = tables.rows(f"select run, label, name from {ALL_OBJECTS} {of_runs} and name is not null", [runs])
    names = {(one["run"], one["label"]): one["name"] for one in named}
    cards = []
    for row in rows:
        folder, which = results.get(row["run"]), f"{row['recording']}#{row['label']}"
        picture = f"api/objects/{quote(row['recording'], safe='/')}/{row['label']}/picture"
        card = Card(
            f"{row['run']}#{row['label']}",
            row,
            picture if row["has_picture"] else None,
            None if folder is None else f"{quote(folder)}/{REPORT}#{row['label']}",
            _standing(row, names),
            row["recording"],
            {"Similar": f"?{urlencode({'like': which})}"} if row["colors"] else {},
        )
        cards.append(answering(card, f"{picture}?last=true" if row["has_picture"] else None, understood))
    return cards


def _standing(row: Mapping[str, Any], names: Mapping[tuple[str, int], str]) -> str | None:
    """Return on or in what an object is, in words; None if it is not known."""
    found = [
        Relation(to=one["surface"] if one["label"] is None else one["label"], kind=one["kind"], score=one["score"])
        for one in row["relations"] or ()
    ]
    planes = {one.to: "a surface" for one in found if isinstance(one.to, str) and one.to not in SURFACES}
    # a surface has a row of its own as the floor, a table or furniture
    known = [one for one in found if one.kind in ("on", "in") and one.to not in planes]
    of_run = {label: name for (run, label), name in names.items() if run == row["run"]}
    return standing_in_words(known or found, {**SURFACES, **planes}, of_run)


def summary_page(summary: StoreSummary, title: str, asked: Mapping[str, str] | None = None) -> str:
    """Return the summary of a store's recordings as HTML; links to the recordings are relative to the store.

    Parameters
    ----------
    summary : StoreSummary
    title : str
        URL of the store.
    asked : mapping, optional
        Parameters of the request, as initial values of the search; a page in a file has no search.
    """
    totals = summary.totals
    shown = {
        "recordings": f"{totals['recordings']:,}",
        "frames": f"{totals['frames']:,}",
        "objects": f"{totals['objects']:,}",
        "tracking time": _duration(3600.0 * totals["hours"]),
        "not done": f"{sum(row['count'] for row in summary.failed):,}",
    }
    head = "".join(
        f'<div class="figure"><strong>{escape(value)}</strong><span>{escape(name)}</span></div>'
        for name, value in shown.items()
    )
    parts = [f'<div class="figures">{head}</div>']
    if summary.failed:
        parts.append(f"<h2>Not done</h2>{_list(_failure(row) for row in summary.failed[: WORST + MORE])}")
    worst, more = summary.worst[:WORST], summary.worst[WORST:]
    if worst:
        parts.append("<h2>Recordings, the ones to check first at the top</h2>" + _list(map(_recording, worst)))
    if more:
        parts.append(f"<h2>The next {len(more)}</h2>" + _list(map(_recording, more)))
    links = {} if asked is None else {"Objects": SEARCH, "Recordings": ""}
    empty = "" if worst or summary.failed else '<p class="empty">No recording matches.</p>'
    form = "" if asked is None else _recording_form(asked.get("recording", ""))
    answer = Searched(empty, "".join(parts))
    return page_html(_name_of(title), title, counted(totals["recordings"], "recording"), answer, links=links, form=form)


def _list(lines: Iterable[str]) -> str:
    return f'<ul class="recordings">{"".join(lines)}</ul>'


def _failure(row: Mapping[str, Any]) -> str:
    count = "" if row["count"] == 1 else f" and {row['count'] - 1:,} more"
    name, reason = escape(row["recording"]), escape(row["reason"] or "")
    return f'<li><span>{name}{count}</span><span class="fine">{escape(row["state"])}</span><span>{reason}</span></li>'


def _recording(row: Mapping[str, Any]) -> str:
    name = escape(str(row["recording"]))
    if row["results"]:
        name = f'<a href="{quote(row["results"])}/{REPORT}">{name}</a>'
    counts = f"{counted(row['objects'] or 0)}, {row['frames_used']} of {row['frames_read']} frames used"
    faults = "".join(f"<li>{escape(fault)}</li>" for fault in _faults(row))
    checks = f"<ul>{faults}</ul>" if faults else '<span class="fine">nothing to check</span>'
    return f'<li><span>{name}</span><span class="fine">{counts}</span>{checks}</li>'


def _faults(row: Mapping[str, Any]) -> list[str]:
    """Return what is to be checked in a recording, in words."""
    found = []
    if row["objects"] == 0:
        found.append("no object was found")
    if row["frames_used"] < row["frames_read"]:
        found.append(f"{counted(row['frames_read'] - row['frames_used'], 'frame')} not used")
    for name, meaning in _FAULTS.items():
        count = round((row[name] or 0.0) * max(row["objects"] or 0, 1))
        if count:
            found.append(f"{name}: {counted(count)} {meaning}")
    ended = round((row["labels that did not last"] or 0.0) * max(row["labels"] or 0, 1))
    if ended:
        found.append(f"{counted(ended, 'label')} ended: merged into another one, or retired")
    return found


def _recording_form(value: str) -> str:
    field = (
        f'<input type="search" name="recording" value="{escape(value)}" placeholder="kitchen*" autocomplete="off" '
        'aria-label="Names of recordings" title="* is any text" spellcheck="false">'
    )
    return f'<form role="search" class="ask">{field}<button type="submit">Search</button></form>'


def _duration(seconds: float) -> str:
    """Return a duration in the unit that suits it."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:,.1f} h"


def _name_of(url: str) -> str:
    return PurePosixPath(url.rstrip("/")).name or url
