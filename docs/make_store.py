"""Make the tables in docs/store.md from the schema of the store: ``python docs/make_store.py``."""

from __future__ import annotations

import re
from pathlib import Path

from cuboid.store.schema import markdown

PAGE = Path(__file__).resolve().parent / "store.md"
BEGIN, END = "<!-- tables: made by docs/make_store.py -->\n", "<!-- end of tables -->\n"

if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    made = f"{BEGIN}\n{markdown()}\n{END}"
    PAGE.write_text(re.sub(f"{BEGIN}.*?{END}", lambda _: made, text, flags=re.DOTALL), encoding="utf-8")
    print(PAGE)
