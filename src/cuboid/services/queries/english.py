"""Questions in plain English, such as "the blue bin beside the chair", as conditions: a small grammar, no model.

question
    [LEAD] [the | a | all | ...] {COLOR | SIZE | SUPERLATIVE} [NAME | LABEL | thing] {CLAUSE} [last seen]
LEAD
    find, show me, list, is there, what is, which things are, where is, when was ...
SUPERLATIVE
    largest, biggest, smallest, tallest, lowest: of the objects that meet all other conditions
CLAUSE
    left of | right of | behind | in front of | nearest to NAME | LABEL: as the camera of its last sighting saw it;
    on | in | beside | next to | near | within LENGTH of, and NAME | LABEL | floor | table | plane:N;
    larger than | smaller than | at least | at most | about LENGTH, between LENGTH and LENGTH;
    since | before DATE, in the last NUMBER minutes | hours | days | weeks; in recording GLOB
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import inf
from typing import Any

from cuboid.ground.core.errors import InputError, shown
from cuboid.services.queries.filters import LIMIT, Filters, is_kind
from cuboid.services.queries.likeness import COLOR_WORDS
from cuboid.services.queries.words import length, moment

# The longest side of small things (cups, cans) is below the first, that of large things (chairs, bins) above the
# second, metres.
SMALL_M, LARGE_M = 0.15, 0.4
# Sizes "about" a length differ from it by at most this fraction.
ABOUT = 0.25

# The words for a question how many objects there are.
COUNT = "their number"
# The words for a question where or when an object was seen.
WHERE = "where and when it was seen last"

_LEAD = re.compile(
    r"(please )?(?:((?:find|search for|look for|list|get|count)|(?:show|give|tell)(?: me)?)\b"
    r"|(?P<last>where|when) (?:is|are|was|were|did you (?:last )?see|have you seen)\b"
    r"|(?:is|are) there\b|(?:what|which)(?: (?:objects?|things?))?(?: (?:is|are|stands?|lies|lie))?\b"
    r"|do you see\b|have you seen\b|(?P<count>how many)\b)\s*(?P<rest>.*)"
)
_SEEN = re.compile(r"\b(?:last seen|seen last|last|seen)$")
_FILLER = re.compile(
    r"(?:the|an?|any|all|every|each|of|some|my|our|its|that|which|who|is|are|was|were|there|and|it|with|"
    r"stand(?:s|ing)?|l(?:ies|ying)|sit(?:s|ting)?|placed|located|kept|long|in size|seen|"
    r"colou?red|called|named|you (?:can )?see)"
    r"(?=\s|$)"
)
_THING = re.compile(r"(?:things?|objects?|items?|anything|something|everything|stuff|ones?)(?=\s|$)")
_L = r"(\d+(?:\.\d+)?|\.\d+)\s*(mm|cm|m|)(?=\s|$)"
_LABEL = re.compile(r"(?:(?:object|label|number) )?#?(\d{1,9})(?=\s|$)")
_SURFACE = re.compile(r"((?:plane|wall):\d{1,9})(?=\s|$)")
_AGO = {"minute": "min", "hour": "h", "day": "d", "week": "w"}


@dataclass(frozen=True, slots=True)
class Understood:
    """A question as conditions.

    Attributes
    ----------
    filters : Filters
    last : str or None
        Label or name of the object whose last sighting is asked for, if that is the whole question.
    said : tuple of str
        The conditions in words, to print.
    """

    filters: Filters
    last: str | None
    said: tuple[str, ...]


def understand(question: str, names: Sequence[str], limit: int = LIMIT) -> Understood:
    """Return a question in English as conditions.

    Parameters
    ----------
    question : str
    names : sequence of str
        Names and classes that objects have, in lower case: a name may have several words.
    limit : int
        Maximum number of objects.

    Raises
    ------
    InputError
        A part of the question is not understood; the message says which, and what is.
    """
    reader = _Reader(question, names)
    reader.read()
    filters = Filters(**reader.values, limit=limit)
    alone = set(reader.values) == {"name"} or reader.label is not None
    if reader.label is not None and (reader.values or not reader.asks_last):
        raise InputError(
            f"{shown(question)}: a label, #{reader.label}, is only understood in 'where is {reader.label}'"
        )
    last = (reader.label or filters.name) if reader.asks_last and alone else None
    more = (WHERE,) * reader.asks_last + (COUNT,) * reader.asks_count
    return Understood(filters, last, (*(reader.said or ["all objects"]), *more))


class _Reader:
    """Reads a question from left to right.

    Attributes
    ----------
    values : dict of str to object
        Fields of `Filters`.
    said : list of str
    label : str or None
        The label of the object, if the question has one.
    asks_last : bool
        Whether the question is where or when an object was seen.
    asks_count : bool
        Whether the question is how many objects there are.
    """

    def __init__(self, question: str, names: Sequence[str]) -> None:
        self._question = question
        self._rest = re.sub(r"[?!,\"“”]|\.(?=\s|$)", " ", question.strip().lower())
        self._rest = re.sub(r"\s+", " ", self._rest).strip()
        self._names = sorted(names, key=len, reverse=True)
        self.values: dict[str, Any] = {}
        self.said: list[str] = []
        self.label: str | None = None
        self.asks_last = self.asks_count = False

    def read(self) -> None:
        """Read the whole question."""
        if not self._rest:
            raise InputError("the question is empty: expected for example 'the blue bin beside the chair'")
        lead = _LEAD.match(self._rest)
        if lead is not None:
            self.asks_last, self._rest = lead["last"] is not None, lead["rest"].strip()
            self.asks_count = lead["count"] is not None
        end = _SEEN.search(self._rest)
        if end is not None:
            self.asks_last, self._rest = True, self._rest[: end.start()].strip()
        while self._rest:
            if not (self._skip() or self._clause() or self._head()):
                self._refuse()

    def _skip(self) -> bool:
        """Skip a word without a meaning of its own."""
        return self._take(_FILLER) is not None or self._take(_THING) is not None

    def _clause(self) -> bool:
        """Read a condition that begins with words of the grammar; return False if there is none."""
        if self._name_here(least_words=2):
            return False
        for pattern, read in _CLAUSES:
            found = self._take(pattern)
            if found is not None:
                read(self, found)
                return True
        return False

    def _head(self) -> bool:
        """Read the name or the label of the objects; return False if the question has one already."""
        if "name" in self.values or self.label is not None:
            return False
        found = self._take(_LABEL)
        if found is not None:
            self.label = found[1]
            self.said.append(f"object {found[1]}")
            return True
        self.put("name", self._name(), "named '{}'")
        return True

    def put(self, field: str, value: object, text: str) -> None:
        """Set a field of the filters, and the words for it; a field is set once."""
        if field in self.values:
            raise InputError(f"{shown(self._question)}: two conditions of one kind: {text.format(value)}")
        self.values[field] = value
        self.said.append(text.format(value))

    def relate(self, field: str, text: str) -> None:
        """Read the object or the surface of a relation."""
        while self._take(_FILLER) is not None:
            pass
        if not self._rest:
            raise InputError(f"{shown(self._question)}: {text.format('what')}? Expected a name, a label, or floor")
        found = self._take(_SURFACE) or self._take(_LABEL)
        name = found[1] if found is not None else self._name()
        quoted = f"the {name}" if is_kind(name) else f"'{name}'"
        self.put(field, name, text.replace("{}", quoted) if found is None else text)

    def size(self, low_m: float, high_m: float, text: str) -> None:
        """Set a range of the longest side, within the one that was set before."""
        low, high = self.values.get("size_m", (0.0, inf))
        self.values["size_m"] = max(low, low_m), min(high, high_m)
        self.said.append(f"longest side {text}")

    def _name(self) -> str:
        """Read a name: the longest one that an object has, also in the plural, else a single word."""
        known = self._name_here()
        if known is not None:
            name, end = known
        else:
            name, _, after = self._rest.partition(" ")
            end = len(name)
            ends = not after or any(one.match(after) for one in (_FILLER, *(pattern for pattern, _ in _CLAUSES)))
            if not ends or not name.replace("-", "").replace("_", "").isalnum():
                self._refuse()
        self._rest = self._rest[end:].strip()
        return name

    def _name_here(self, least_words: int = 1) -> tuple[str, int] | None:
        """Return a known name with which the rest begins, and its length there."""
        for name in self._names:
            found = re.match(rf"{re.escape(name)}(?:e?s)?(?=\s|$)", self._rest)
            if found is not None and name.count(" ") >= least_words - 1:
                return name, found.end()
        return None

    def _take(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Take a pattern from the beginning of the rest."""
        found = pattern.match(self._rest)
        if found is not None:
            self._rest = self._rest[found.end() :].strip()
        return found

    def _refuse(self) -> None:
        understood = f"; understood: {', '.join(self.said)}" if self.said else ""
        raise InputError(
            f"{shown(self._question)}: not understood from {shown(self._rest)} on{understood}. A question has colors, "
            "'small' or 'large', a name, and on, in, beside, near, left of or behind something, such as 'the blue bin "
            "beside the chair'"
        )


def _metres(number: str, unit: str) -> float:
    try:
        return length(f"{number}{unit}")
    except ValueError as error:
        raise InputError(str(error)) from None


def _time(text: str) -> datetime:
    try:
        return moment(text)
    except ValueError as error:
        raise InputError(str(error)) from None


def _between(reader: _Reader, found: re.Match[str]) -> None:
    low, high = _metres(found[1], found[2] or found[4]), _metres(found[3], found[4])
    reader.size(low, high, f"{100 * low:g} to {100 * high:g} cm")


def _about(reader: _Reader, found: re.Match[str]) -> None:
    size = _metres(found[1], found[2])
    low, high = round(size * (1 - ABOUT), 6), round(size * (1 + ABOUT), 6)
    reader.size(low, high, f"{100 * low:g} to {100 * high:g} cm (about {100 * size:g} cm)")


def _larger(reader: _Reader, found: re.Match[str]) -> None:
    reader.size(_metres(found[1], found[2]), inf, f"at least {100 * _metres(found[1], found[2]):g} cm")


def _smaller(reader: _Reader, found: re.Match[str]) -> None:
    reader.size(0.0, _metres(found[1], found[2]), f"at most {100 * _metres(found[1], found[2]):g} cm")


def _within(reader: _Reader, found: re.Match[str]) -> None:
    reader.put("within_m", _metres(found[1], found[2]), "at most {} m away")
    reader.relate("near_object", "from {}")


def _nearest(reader: _Reader, found: re.Match[str]) -> None:
    reader.put("order", "nearest", "only the nearest")
    reader.values["within_m"] = inf
    reader.relate("near_object", "to {}")


def _ordered(reader: _Reader, found: re.Match[str]) -> None:
    order = {"biggest": "largest", "highest": "tallest", "shortest": "lowest"}.get(found[1], found[1])
    reader.put("order", order, "only the {}")


def _beside_as_seen(reader: _Reader, found: re.Match[str]) -> None:
    reader.relate("side", f"{found[1]} {{}}")
    reader.values["side"] = found[1], reader.values["side"]


def _in_the_last(reader: _Reader, found: re.Match[str]) -> None:
    reader.put("since", _time(f"{found[1] or '1'}{_AGO[found[2]]}"), "last seen since {:%Y-%m-%d %H:%M} UTC")


def _relation(field: str, text: str) -> Callable[[_Reader, re.Match[str]], None]:
    return lambda reader, _: reader.relate(field, text)


# The clauses in the order in which they are tried.
_CLAUSES: tuple[tuple[re.Pattern[str], Callable[[_Reader, re.Match[str]], None]], ...] = (
    (re.compile(rf"between {_L} and {_L}"), _between),
    (re.compile(rf"(?:(?:larger|bigger|longer|taller|wider|more) than|at least|over|above) {_L}"), _larger),
    (re.compile(rf"(?:(?:smaller|shorter|less) than|at most|up to) {_L}"), _smaller),
    (re.compile(rf"(?:about|around|roughly|approximately|some) {_L}"), _about),
    (re.compile(rf"within {_L} (?:of|from)\b"), _within),
    (re.compile(r"(?:in|within|during) the (?:last|past) (\d+)? ?(minute|hour|day|week)s?\b"), _in_the_last),
    (
        re.compile(r"(?:last seen |seen )?since (\S+)"),
        lambda reader, found: reader.put("since", _time(found[1].upper() if "t" in found[1] else found[1]), "since {}"),
    ),
    (
        re.compile(r"(?:last seen |seen )?(?:before|until) (\S+)"),
        lambda reader, found: reader.put("until", _time(found[1].upper() if "t" in found[1] else found[1]), "until {}"),
    ),
    (
        re.compile(r"(?:in|of|from) (?:the )?recordings? (\S+)"),
        lambda reader, found: reader.put("recording", found[1], "in recordings '{}'"),
    ),
    (re.compile(r"(?:to the )?(left of|right of)\b"), _beside_as_seen),
    (re.compile(r"(behind|in front of)\b"), _beside_as_seen),
    (re.compile(r"(?:nearest|closest)(?: to)?(?=\s|$)"), _nearest),
    (re.compile(r"(largest|biggest|smallest|tallest|highest|shortest|lowest)(?=\s|$)"), _ordered),
    (re.compile(r"on(?: top of)?(?=\s|$)"), _relation("on", "on {}")),
    (re.compile(r"(?:inside(?: of)?|in|within|into)(?=\s|$)"), _relation("inside", "in {}")),
    (re.compile(r"(?:beside|next to|by|at the side of|alongside)(?=\s|$)"), _relation("beside", "beside {}")),
    (re.compile(r"(?:near(?:by)?(?: to)?|close to|around)(?=\s|$)"), _relation("near_object", "near {}")),
    (
        re.compile(r"(?:small|little|tiny)(?=\s|$)"),
        lambda reader, _: reader.size(0.0, SMALL_M, f"at most {100 * SMALL_M:g} cm (small)"),
    ),
    (
        re.compile(r"(?:large|big|huge)(?=\s|$)"),
        lambda reader, _: reader.size(LARGE_M, inf, f"at least {100 * LARGE_M:g} cm (large)"),
    ),
    (
        re.compile(rf"({'|'.join((*COLOR_WORDS, 'gray'))})(?=\s|$)"),
        lambda reader, found: reader.put("color", found[1].replace("gray", "grey"), "color {}"),
    ),
)
