"""Make the tables in docs/store.md and docs/exports.md from the declarations: ``python docs/make_tables.py``."""

from __future__ import annotations

import re
from pathlib import Path

from cuboid.fleet.store import schema
from cuboid.results.exports import registry

HERE = Path(__file__).resolve().parent
TABLES = {"store.md": ("tables", schema.markdown), "exports.md": ("exports", registry.markdown)}


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
