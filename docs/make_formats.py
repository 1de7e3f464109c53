"""Make docs/formats.md and docs/schemas from the program's own descriptions: ``python docs/make_formats.py``."""

from __future__ import annotations

import json
from pathlib import Path

from cuboid.ground.formats.describe import DOCUMENTS, markdown, schema_of

HERE = Path(__file__).resolve().parent


def files() -> dict[Path, str]:
    """Return the content of each file that is made."""
    schemas = {
        HERE / "schemas" / name.replace(".json", ".schema.json"): json.dumps(schema_of(kind), indent=1) + "\n"
        for name, kind in DOCUMENTS.items()
    }
    return {HERE / "formats.md": markdown(), **schemas}


if __name__ == "__main__":
    for path, text in files().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path)
