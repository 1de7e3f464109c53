"""Make the tables in docs/store.md and docs/exports.md from the declarations: ``python docs/make_tables.py``."""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa

from cuboid.fleet.store import schema
from cuboid.results.exports import EXPORTS

HERE = Path(__file__).resolve().parent
DAY = schema.Column(
    "day", pa.date32(), "date of `recorded`, UTC: in the name of the folder, `day=2026-03-01`, not in the file"
)


def store_tables() -> str:
    """Return the tables of a store."""
    parts = []
    for kind in schema.TABLES.values():
        lines = [f"### `{kind.name}`", "", f"A row: {kind.row}.", "", "| column | type | meaning |", "|---|---|---|"]
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
        needs = f"; needs [the extra `{form.extra}`](install.md#extras)" if form.extra else ""
        lines.append(f"| `{name}` | {f'`{form.suffix}`' if form.suffix else 'a folder'} | {form.purpose}{needs} |")
    return "\n".join(lines) + "\n"


TABLES = {"store.md": ("tables", store_tables), "exports.md": ("exports", exports_table)}


def files() -> dict[Path, str]:
    """Return the content of each page that has such tables."""
    made = {}
    for name, (subject, markdown) in TABLES.items():
        begin, end = f"<!-- {subject}: made by docs/make_tables.py -->\n", f"<!-- end of {subject} -->\n"
        tables, old = f"{begin}\n{markdown()}\n{end}", (HERE / name).read_text(encoding="utf-8")
        made[HERE / name] = re.sub(f"{begin}.*?{end}", lambda _, tables=tables: tables, old, flags=re.DOTALL)
    return made


if __name__ == "__main__":
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
        print(path)
