"""The search form of a served page: plain HTML that requests the same page with other parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from cuboid.services.queries.parameters import PARAMETERS, SELDOM

# CSS in addition to the style of the store's pages.
STYLE = """
.search {
  display: grid;
  grid-template-columns: repeat(auto-fill, minmax(136px, 1fr));
  gap: 10px 12px;
  align-items: end;
  padding-bottom: 22px;
}
.search label { display: grid; gap: 3px; font-size: 12px; color: var(--muted); }
.search input, .search select {
  font: inherit;
  font-size: 13px;
  color: var(--text);
  width: 100%;
  height: 32px;
  padding: 0 10px;
  background: var(--raised);
  border: 1px solid var(--line);
  border-radius: 6px;
}
.search ::placeholder { color: var(--muted); opacity: .7; }
.search details { grid-column: 1 / -1; }
.search summary { color: var(--muted); font-size: 12px; cursor: pointer; width: fit-content; }
.search details[open] summary { padding-bottom: 8px; }
.fields { display: grid; grid-template-columns: repeat(auto-fill, minmax(136px, 1fr)); gap: 10px 12px; }
.buttons { display: flex; align-items: center; gap: 14px; height: 32px; }
.search button {
  height: 32px;
  padding: 0 16px;
  border-radius: 6px;
  background: var(--accent);
  color: var(--on-accent);
  font-weight: 550;
}
.fault { color: var(--bad); padding-bottom: 18px; overflow-wrap: anywhere; }
"""


def search_form(address: str, names: Sequence[str], asked: Mapping[str, str], fault: str = "") -> str:
    """Return a form with a field for each parameter.

    Parameters
    ----------
    address : str
        Address of the page that answers the form, relative to the page with the form.
    names : sequence of str
        Keys of `PARAMETERS`.
    asked : mapping
        Values of the present request, as initial values of the fields.
    fault : str
        Reason why the request was refused, in one line.
    """
    fields = "".join(_field(name, asked.get(name, "")) for name in names if name not in SELDOM)
    seldom = [name for name in names if name in SELDOM]
    if seldom:
        is_open = " open" if any(asked.get(name) for name in seldom) else ""
        inner = "".join(_field(name, asked.get(name, "")) for name in seldom)
        more = f'<details{is_open}><summary>More conditions</summary><div class="fields">{inner}</div></details>'
    else:
        more = ""
    clear = f'<a href="{escape(address)}">Clear</a>' if any(asked.values()) else ""
    return (
        f'<form class="search" role="search" action="{escape(address)}">{fields}'
        f'<div class="buttons"><button>Search</button>{clear}</div>{more}</form>'
        + (f'<p class="fault" role="alert">{escape(fault)}</p>' if fault else "")
    )


def _field(name: str, value: str) -> str:
    parameter = PARAMETERS[name]
    shared = f'name="{name}" title="{escape(parameter.meaning)}"'
    if choices := parameter.schema.get("enum"):
        options = "".join(
            f"<option{' selected' if choice == value else ''}>{escape(choice)}</option>" for choice in ("", *choices)
        )
        inner = f"<select {shared}>{options}</select>"
    else:
        example = escape(str(parameter.schema.get("example", parameter.schema.get("default", ""))))
        inner = (
            f'<input {shared} value="{escape(value)}" placeholder="{example}" autocomplete="off" spellcheck="false">'
        )
    return f"<label>{escape(parameter.field)}{inner}</label>"
