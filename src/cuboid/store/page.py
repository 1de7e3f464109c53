"""stub"""

from __future__ import annotations


def write_summary(store: str) -> None: ...
