"""The 3D page of a run: one file that a browser opens from disk, without a network."""

from __future__ import annotations

from cuboid.results.views.report.page import page_of, write_report
from cuboid.results.views.report.summary import Summary, pictures_of, summarise

__all__ = ["Summary", "page_of", "pictures_of", "summarise", "write_report"]
