"""The tables of a store and of the exports, made from their declarations for `make_reference.py`."""

from __future__ import annotations

import pyarrow as pa

from cuboid.fleet.store import schema
from cuboid.results.exports import EXPORTS

DAY = schema.Column(
    "day", pa.date32(), "date of `recorded`, UTC: in the name of the folder, `day=2026-03-01`, not in the file"
)


def store_tables() -> str:
    """Return the tables of a store."""
    parts = []
    for kind in schema.TABLES.values():
        lines = [f"## `{kind.name}`", "", f"A row: {kind.row}.", "", "| column | type | meaning |", "|---|---|---|"]
        lines += [f"| `{c.name}` | {_plain(c.type)} | {c.meaning} |" for c in (*kind.columns, DAY)]
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _plain(kind: pa.DataType) -> str:
    words = {"timestamp[us, tz=UTC]": "time (UTC)", "double": "float64", "float": "float32"}
    if pa.types.is_list(kind):
        return f"list of {_plain(kind.value_type)}"
    if pa.types.is_struct(kind):
        return "struct of " + ", ".join(field.name for field in kind)
    return words.get(str(kind), str(kind))


def exports_table() -> str:
    """Return the table of all exports."""
    lines = ["| `--to` | PATH | for |", "|---|---|---|"]
    for name, form in EXPORTS.items():
        needs = f"; needs [the extra `{form.extra}`](../index.md#extras)" if form.extra else ""
        lines.append(f"| `{name}` | {f'`{form.suffix}`' if form.suffix else 'a folder'} | {form.purpose}{needs} |")
    return "\n".join(lines) + "\n"
