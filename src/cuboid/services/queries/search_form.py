"""The form of a search page: a question in English, and the most usual conditions as fields."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from cuboid.services.queries.parameters import PARAMETERS, QUESTION

ASK = "q"
# Fields that are always there; other conditions of an address get a field as well.
FIELDS = ("name", "color", "min_size", "max_size", "on", "since", "until", "min_probability")
# Number of names that a field proposes.
PROPOSED = 100
_GLASS = (
    '<svg class="glass" viewBox="0 0 24 24" aria-hidden="true">'
    '<circle cx="10.5" cy="10.5" r="6.5"/><path d="m15.5 15.5 5 5"/></svg>'
)
_MORE = '<button id="more" type="button" aria-expanded="false" aria-controls="filters">Filters<b hidden></b></button>'


def search_form(
    asked: Mapping[str, str],
    fields: Sequence[str] = FIELDS,
    surfaces: Mapping[str, str] | None = None,
    names: Iterable[str] = (),
) -> str:
    """Return the form as HTML.

    Parameters
    ----------
    asked : mapping
        Parameters of the request, as initial values.
    fields : sequence of str
        Keys of `PARAMETERS`.
    surfaces : mapping of str to str, optional
        Values of the field `on`, with their texts.
    names : iterable of str
        Names that the field `name` proposes.
    """
    further = [name for name in PARAMETERS if asked.get(name) and name not in fields and name != "limit"]
    inputs = "".join(_field(name, asked.get(name, ""), surfaces or {}) for name in (*fields, *further))
    options = "".join(f'<option value="{escape(name)}"></option>' for name in list(names)[:PROPOSED])
    question = (
        f'<input type="search" name="{ASK}" value="{escape(asked.get(ASK, ""))}" title="{escape(QUESTION.meaning)}" '
        f'placeholder="{escape(str(QUESTION.schema["example"]))}" aria-label="Question in English" autocomplete="off" '
        'spellcheck="false" enterkeyhint="search">'
    )
    go = f'<button type="submit" aria-label="Search">{_GLASS}<span class="word">Search</span></button>'
    return (
        f'<form id="search" role="search"><div class="ask">{question}{_MORE}{go}</div>'
        f'<div id="filters" class="fields" role="group" aria-label="Filters">{inputs}</div>'
        f'<datalist id="names">{options}</datalist></form>'
    )


def _field(name: str, value: str, surfaces: Mapping[str, str]) -> str:
    parameter = PARAMETERS[name]
    label = f'<label for="field-{name}">{escape(parameter.field)}</label>'
    shared = f'id="field-{name}" name="{name}" title="{escape(parameter.meaning)}"'
    choices = surfaces if name == "on" else {str(one): str(one) for one in parameter.schema.get("enum", ())}
    if name == "min_probability":
        slider = f'<input type="range" min="0" max="1" step="0.01" {shared} value="{escape(value or "0")}">'
        return f'<div class="field range">{label}{slider}<output for="field-{name}"></output></div>'
    if choices:
        every = {"": "any", **({value: value} if value else {}), **choices}
        options = "".join(
            f'<option value="{escape(one)}"{" selected" if one == value else ""}>{escape(words)}</option>'
            for one, words in every.items()
        )
        return f'<div class="field">{label}<select {shared}>{options}</select></div>'
    example = escape(str(parameter.schema.get("example", parameter.schema.get("default", ""))))
    proposed = ' list="names"' if name == "name" else ""
    typed = f'value="{escape(value)}" placeholder="{example}" autocomplete="off" spellcheck="false"'
    return f'<div class="field">{label}<input {shared}{proposed} {typed}></div>'
