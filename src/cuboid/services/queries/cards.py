"""Found objects as cards of a page, as HTML; the same for a place, for a store, and for a page in a file."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from html import escape
from typing import Any

from cuboid.ground.core.palette import color_of, hex_of, ink_on
from cuboid.ground.core.results import tag_of
from cuboid.services.queries.english import WHERE
from cuboid.services.queries.likeness import WORDS
from cuboid.services.queries.rows import later_text, seen_text, size_of, unseen_of

LIKELY = "probability that it is one whole object"


@dataclass(frozen=True, slots=True)
class Card:
    """An object of a page.

    Attributes
    ----------
    key : str
        Identity of the object within the page.
    row : mapping
        Columns of `cuboid find`.
    picture : str or None
        Address of its picture.
    page : str or None
        Address of the 3D page at the object; None if there is none.
    standing : str or None
        On or in what it is.
    recording : str or None
        Name of its recording, where there are several.
    links : mapping of str to str
        Addresses of further links, by their texts.
    """

    key: str
    row: Mapping[str, Any]
    picture: str | None
    page: str | None = None
    standing: str | None = None
    recording: str | None = None
    links: Mapping[str, str] = field(default_factory=dict)


def answering(card: Card, last: str | None, understood: Collection[str]) -> Card:
    """Return a card as the answer to a question: with the last picture if the question is where the object is.

    Parameters
    ----------
    card : Card
        With the best picture, and the page of the map, which shows the objects that are still in it.
    last : str or None
        Address of the picture of its last sighting; None if there is none.
    understood : collection of str
        The conditions of the question, in words.
    """
    page = card.page if card.row["state"] == "present" else None
    if WHERE in understood:
        return replace(card, page=page, picture=last or card.picture)
    links = {} if last is None else {"Last picture": last}
    return replace(card, page=page, links={**links, **card.links})


def cards_html(cards: Iterable[Card]) -> str:
    """Return the list of cards as HTML."""
    return f'<ol id="cards">{"".join(map(_card, cards))}</ol>'


def _card(card: Card) -> str:
    row = card.row
    tag = escape(tag_of(row["label"], row.get("name")))
    source = card.picture
    image = "" if source is None else f'<img src="{escape(source)}" alt="" loading="lazy" decoding="async">'
    shown = "shot" if source is not None else "shot bare"
    if card.page is None:
        shot = f'<div class="{shown}">{image}</div>'
    else:
        shot = f'<a class="{shown}" href="{escape(card.page)}" tabindex="-1" aria-hidden="true">{image}</a>'
    chip = f'<span class="chip" style="{_chip(row["label"])}" title="{tag}">{tag}</span>'
    likely = "" if row["probability"] is None else f"probability {row['probability']:.2f}"
    lines = [
        "" if card.recording is None else f'<p class="whose">{escape(card.recording)}</p>',
        f'<div class="title">{chip}<span class="likely" title="{LIKELY}">{likely}</span></div>',
        _size(row),
    ]
    looks = " · ".join(filter(None, (_colors(row["colors"]), escape(card.standing or ""))))
    lines += [f"<p>{looks}</p>" if looks else "", _seen(row)]
    links = {**({} if card.page is None else {"Show in 3D": card.page}), **card.links}
    named = "".join(
        f'<a href="{escape(address)}" aria-label="{escape(text)}: {tag}">{escape(text)}</a>'
        for text, address in links.items()
    )
    lines.append(f'<div class="links">{named}</div>' if links else "")
    return f'<li class="card" data-card="{escape(card.key)}">{shot}<div class="about">{"".join(lines)}</div></li>'


def _chip(label: int) -> str:
    ink = "".join(f"{part:02x}" for part in ink_on(color_of(label)))
    return f"background:{hex_of(label)};color:#{ink}"


def _size(row: Mapping[str, Any]) -> str:
    """Return the size, and as a hint half the 95 % interval of each side."""
    unseen = unseen_of(row)
    hint = f"length, width, height: {size_of(row, ' × ', errors=True)} cm"
    behind = f'<span class="fine"> · {unseen}</span>' if unseen else ""
    return f'<p title="{hint}">{size_of(row, " × ")} cm{behind}</p>'


def _colors(words: Iterable[str]) -> str:
    swatches = [
        f'<i class="swatch" style="background:rgb{WORDS[word][0]}"></i>{escape(word)}'
        for word in words
        if word in WORDS
    ]
    return " and ".join(swatches)


def _seen(row: Mapping[str, Any]) -> str:
    """Return what is known since the last sighting, and when, by which camera and from how far that was."""
    later = row.get("later")
    known = "" if later is None else f'<span class="state {later.split()[0]}">{escape(later_text(row))}</span>; '
    distances = "".join(
        f'<p class="seen">{text} {row[name]:.{digits}f}{unit}</p>'
        for name, text, digits, unit in (
            ("distance_m", "distance", 2, " m"),
            ("unlike", "difference", 3, ", 0 is the same"),
            ("text_score", "fits the text by", 3, ", at most 1"),
        )
        if row.get(name) is not None
    )
    return f'<p class="seen">{known}last seen in {escape(seen_text(row))}</p>{distances}'
