"""Pages of a store: the outcome of its recordings, and search results; each page is one file without scripts."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any
from urllib.parse import quote, urlencode

from cuboid.fleet.store.place import Place
from cuboid.fleet.store.query import Tables
from cuboid.fleet.store.search_form import STYLE as FORM_STYLE
from cuboid.fleet.store.search_form import search_form
from cuboid.fleet.store.summary import INDICATORS, StoreSummary, summarise_store
from cuboid.results.views.report.page import document_page, table
from cuboid.services.queries.parameters import PARAMETERS
from cuboid.services.queries.rows import cells_of

NAME = "index.html"

# Number of recordings on the page, the worst first, and of further ones in a folded list; `cuboid sql` has all.
WORST, MORE = 10, 490

# CSS in addition to the style that all pages share.
STYLE = """
.document > * + h2 { padding-top: 28px; }
.scrolls { overflow-x: auto; }
tbody tr:hover > td { background: var(--hover); }
td img { display: block; height: 52px; border-radius: 4px; }
td.bar { background: linear-gradient(90deg, color-mix(in srgb, var(--bad) 45%, transparent) var(--of), transparent 0); }
.figure, .figures { min-width: 0; }
.note { color: var(--muted); padding-top: 8px; }
h1 { max-width: none; flex: 1; }
a { color: inherit; text-decoration-color: var(--muted); text-underline-offset: 3px; }
"""


def write_summary(store: str) -> None:
    """Write the summary page of a store into it.

    Raises
    ------
    InputError, OutputError
        The store cannot be read or written.
    """
    place = Place(store)
    place.put(NAME, summary_page(summarise_store(Tables(store), WORST + MORE), store).encode("utf-8", "replace"))


def summary_page(
    summary: StoreSummary,
    title: str,
    links: Mapping[str, str] | None = None,
    asked: Mapping[str, str] | None = None,
) -> str:
    """Return the summary of a store's recordings as HTML; links to the recordings are relative to the store.

    Parameters
    ----------
    summary : StoreSummary
    title : str
    links : mapping, optional
        Links of the page, as in `html`.
    asked : mapping, optional
        Parameters of the request, as initial values of the search form; a page in a file has no form.
    """
    totals = summary.totals
    shown = {
        "recordings": f"{totals['recordings']:,}",
        "frames": f"{totals['frames']:,}",
        "objects": f"{totals['objects']:,}",
        "hours of one core": f"{totals['hours']:,.1f}",
        "not done": f"{sum(row['count'] for row in summary.failed):,}",
    }
    head = "".join(
        f'<div class="figure"><strong>{escape(value)}</strong><span>{escape(name)}</span></div>'
        for name, value in shown.items()
    )
    form = search_form(".", ("recording",), asked) if asked is not None else ""
    parts = [form, f'<div class="figures">{head}</div>']
    if summary.failed:
        rows = [
            (str(row["count"]), row["state"], row["recording"], row["reason"] or "")
            for row in summary.failed[: WORST + MORE]
        ]
        parts.append("<h2>Not done</h2>" + _table(("count", "state", "example", "reason"), rows, left=4))
    worst, more = summary.worst[:WORST], summary.worst[WORST:]
    parts.append(f"<h2>To check first</h2>{_recordings(worst)}")
    parts.append(
        '<p class="note">The order is the sum of the fractions at the right: unused frames; objects that overlap '
        "another one by a third or more, stand in free space, or were seen in fewer than five frames; labels that did "
        "not last; and 1 if no object was found.</p>"
    )
    if more:
        parts.append(f"<h2>The next {len(more)}</h2>{_recordings(more)}")
    return html(f"Recordings of {title}", "".join(parts), links)


def _recordings(rows: Iterable[Mapping[str, Any]]) -> str:
    names = ("recording", "frames used", "proposals", "with a label", "sightings", "labels", "objects", *INDICATORS)
    lines = []
    for row in rows:
        name = escape(str(row["recording"]))
        if row["results"]:
            name = f'<a href="{quote(row["results"])}/report.html">{name}</a>'
        counts = (
            f"{row['frames_used']} of {row['frames_read']}",
            row["proposals"],
            row["proposals_labelled"],
            row["sightings"],
            row["labels"],
            row["objects"],
        )
        cells = "".join(f'<td class="number">{escape("" if count is None else str(count))}</td>' for count in counts)
        bars = "".join(_bar(row[indicator]) for indicator in INDICATORS)
        lines.append(f"<tr><td>{name}</td>{cells}{bars}</tr>")
    return _lines(names, lines)


def _bar(fraction: float | None) -> str:
    value = fraction or 0.0
    return f'<td class="number bar" style="--of: {100 * value:.0f}%">{f"{value:.2f}" if value else ""}</td>'


def found_page(
    rows: Sequence[Mapping[str, Any]],
    title: str,
    links: Mapping[str, str] | None = None,
    asked: Mapping[str, str] | None = None,
    fault: str = "",
    names: Sequence[str] = tuple(PARAMETERS),
) -> str:
    """Return search results with pictures, as HTML.

    Parameters
    ----------
    rows : sequence of mapping
        Rows from `find`, with pictures.
    title : str
    links : mapping, optional
        Links of the page, as in `html`.
    asked : mapping, optional
        Parameters of the request, as initial values of the search form; a page in a file has no form.
    fault : str
        Reason why the request was refused.
    names : sequence of str
        Parameters that have a field in the form.
    """
    last = next((name for name in ("text_score", "unlike", "distance_m") if rows and name in rows[0]), None)
    heads = [
        "object",
        "",
        "length x width x height, cm",
        "position, m",
        "color",
        "probability",
        "frames",
        "last seen",
        *([last] if last else []),
    ]
    lines = []
    for row in rows:
        picture = base64.b64encode(row["picture"]).decode("ascii") if row.get("picture") else None
        shown = f'<img alt="" src="data:image/jpeg;base64,{picture}">' if picture else ""
        cells = [*cells_of(row)[1:], *([f"{row[last]:.3f}"] if last else [])]
        tail = "".join(f'<td class="number">{escape(cell)}</td>' for cell in cells)
        similar = f"<td class=number>{_similar(row)}</td>" if asked is not None else ""
        lines.append(f"<tr><td>{escape(cells_of(row)[0])}</td><td>{shown}</td>{tail}{similar}</tr>")
    if asked is not None:
        heads.append("")
    form = search_form("objects", names, asked, fault) if asked is not None else ""
    objects = _lines(heads, lines, left=2) if rows else '<p class="empty">No object matches.</p>'
    return html(title, form if fault else f"{form}<h2>{_counted(len(rows))}</h2>{objects}", links)


def _counted(count: int) -> str:
    return "1 object" if count == 1 else f"{count:,} objects"


def _similar(row: Mapping[str, Any]) -> str:
    """Return a link to the objects most similar to a given one."""
    question = urlencode({"like": f"{row['recording']}#{row['label']}"})
    return f'<a href="objects?{escape(question)}">similar</a>'


def _table(names: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    lines = []
    for row in rows:
        cells = [f"<td{'' if i < left else ' class=number'}>{escape(cell)}</td>" for i, cell in enumerate(row)]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return _lines(names, lines, left)


def _lines(names: Sequence[str], lines: Sequence[str], left: int = 1) -> str:
    return table(names, lines, range(left, len(names)))


def html(title: str, body: str, links: Mapping[str, str] | None = None) -> str:
    """Return a page as HTML; `links` are addresses by name, an empty address is the page itself."""
    leads = "".join(
        f'<a href="{quote(address)}">{escape(name)}</a>' if address else f'<a aria-current="page">{escape(name)}</a>'
        for name, address in (links or {}).items()
    )
    header = f"<h1>{escape(title)}</h1>{f'<nav>{leads}</nav>' if leads else ''}"
    return document_page(title, header, body, STYLE, FORM_STYLE)
