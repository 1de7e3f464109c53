"""The page of a served place: its objects, and the addresses of the API."""

from __future__ import annotations

from html import escape

from cuboid.ground.core.palette import color_of, hex_of, ink_on
from cuboid.ground.core.results import tag_of
from cuboid.results.views.report.page import document_page, table
from cuboid.services.queries.answers import FoundObject
from cuboid.services.queries.filters import Filters
from cuboid.services.queries.place import Place
from cuboid.services.queries.rows import last_seen_lines, later_text, row_of, when
from cuboid.services.service.endpoints import ENDPOINTS
from cuboid.services.service.openapi import SOCKET

# Objects on the page; the API has all.
SHOWN = 50
STYLE = """
.document > * + h2 { padding-top: 28px; }
.scrolls { overflow-x: auto; }
td img { display: block; height: 44px; width: 58px; object-fit: cover; border-radius: 4px; background: var(--raised); }
td:has(img) { width: 1px; }
td .chip { vertical-align: middle; }
a { color: inherit; text-decoration-color: var(--muted); text-underline-offset: 3px; }
h1 { max-width: none; }
.note { color: var(--muted); }
.document .note { padding-top: 8px; }
.seen .note { white-space: normal; min-width: 12em; }
code { font-size: 12.5px; }
"""
_HEAD = ("", "object", "length × width × height, cm", "position, m", "frames", "last seen", "")


def front_page(place: Place) -> str:
    """Return the page as HTML; its addresses are relative to it."""
    about, found = place.about(), place.find(Filters(limit=SHOWN))
    count = "1 object" if about.objects == 1 else f"{about.objects:,} objects"
    more = (
        f'<p class="note">The first {SHOWN}; <code>api/objects</code> finds all.</p>' if about.objects > SHOWN else ""
    )
    objects = (
        table(_HEAD, [_object(one) for one in found], range(2, len(_HEAD) - 1))
        if found
        else '<p class="empty">No object yet.</p>'
    )
    addresses = [(_address(one.path), escape(one.what)) for one in ENDPOINTS]
    addresses.append((f"<code>{SOCKET}</code>", "A WebSocket that sends each change of the map"))
    addresses.append((_address("/openapi.json"), "The description of this API for programs (OpenAPI)"))
    lines = [f"<tr><td>{address}</td><td class=wide>{what}</td></tr>" for address, what in addresses]
    header = f"<h1>{escape(about.title)}</h1><p class=note>{'running, ' if about.running else ''}{count}</p>"
    main = f"<h2>Objects</h2>{objects}{more}<h2>Addresses</h2>{table(('address', 'what'), lines, range(0))}"
    return document_page(about.title, header, main, STYLE)


def _object(one: FoundObject) -> str:
    address = f"api/objects/{one.label}"
    colors = f"background:{hex_of(one.label)};color:#{'{:02x}{:02x}{:02x}'.format(*ink_on(color_of(one.label)))}"
    cells = (
        " × ".join(f"{100 * side:.1f}" for side in one.size_m),
        ", ".join(f"{value:z.2f}" for value in one.center_m),
        f"{one.frames_seen:,}",
    )
    row = row_of(one, "")
    seen = escape(when(row["last_frame"], row["last_recording"], row["last_seen"]))
    last = f'<a href="{address}/picture?last=true" title="{escape(", ".join(last_seen_lines(row)))}">{seen}</a>'
    later = f'<div class="note">{escape(later_text(row))}</div>'
    links = " ".join(f'<a href="{address}/{what}">{what}</a>' for what in ("history", "cloud", "mesh"))
    chip = f'<a class="chip" style="{colors}" href="{address}">{escape(tag_of(one.label, one.name))}</a>'
    numbers = "".join(f'<td class="number">{cell}</td>' for cell in cells)
    numbers += f'<td class="number seen">{last}{later}</td>'
    picture = f'<img src="{address}/picture" alt="" loading="lazy">'
    return f'<tr><td>{picture}</td><td>{chip}</td>{numbers}<td class="number">{links}</td></tr>'


def _address(path: str) -> str:
    shown = f"<code>{escape(path)}</code>"
    return shown if "{" in path or path in ("/api/last-seen", "/api/ask") else f'<a href="{path[1:]}">{shown}</a>'
