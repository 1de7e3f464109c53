"""Summary of a store's recordings, the worst first: the ones to inspect among thousands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cuboid.fleet.store.query import SUPERSEDED, Tables
from cuboid.fleet.store.schema import DONE, RUNS

# Fractions that indicate failure, each from 0 (good) to 1, as SQL; the page is sorted by their sum.
INDICATORS = {
    "frames not used": "1 - frames_used / greatest(frames_read, 1)",
    "overlapping": "overlapping / greatest(objects, 1)",
    "floating": "floating / greatest(objects, 1)",
    "brief": "brief / greatest(objects, 1)",
    "labels that did not last": "greatest(labels - objects, 0) / greatest(labels, 1)",
    "nothing found": "(objects = 0)::int",
}


@dataclass(frozen=True, slots=True)
class StoreSummary:
    """The contents of the summary page.

    Attributes
    ----------
    totals : dict
        Sums over the newest runs: recordings, frames, objects, hours of computing.
    worst : list of dict
        Finished recordings, the worst first: name, run, results, counts, and each of `INDICATORS`.
    failed : list of dict
        Unfinished recordings by kind of reason: state, reason, number of recordings, and one example.
    """

    totals: dict[str, Any]
    worst: list[dict[str, Any]]
    failed: list[dict[str, Any]]


_NEWEST = f"{RUNS} where state = '{DONE}' and {{}} and run not in (select run from {SUPERSEDED})"


def _named(recording: str | None) -> tuple[str, list[str]]:
    return ("recording glob ?", [recording]) if recording is not None else ("true", [])


def totals_of(tables: Tables, recording: str | None = None) -> dict[str, Any]:
    """Return the sums over the newest runs, as in `StoreSummary`; `recording` is a glob of names."""
    named, values = _named(recording)
    return tables.rows(
        "select count(*) as recordings, coalesce(sum(frames_used), 0)::bigint as frames, "
        "coalesce(sum(objects), 0)::bigint as objects, coalesce(sum(seconds), 0) / 3600 as hours, "
        f"max(finished) as finished from {_NEWEST.format(named)}",
        values,
    )[0]


def summarise_store(tables: Tables, limit: int, recording: str | None = None) -> StoreSummary:
    """Return the summary with at most `limit` recordings; `recording` is a glob of their names."""
    named, values = _named(recording)
    newest = _NEWEST.format(named)
    totals = totals_of(tables, recording)
    fractions = ", ".join(f'{sql} as "{name}"' for name, sql in INDICATORS.items())
    together = " + ".join(f"({sql})" for sql in INDICATORS.values())
    worst = tables.rows(
        "select recording, run, results, frames_read, frames_used, frames_lost, proposals, proposals_labelled, "
        f"sightings, labels, objects, len(warnings) as warnings, {fractions}, {together} as badness "
        f"from {newest} order by badness desc, recording limit {limit}",
        values,
    )
    failed = tables.rows(
        # reasons that differ only in words with digits are one kind
        "select state, any_value(reason order by recording) as reason, count(*) as count, "
        f"min(recording) as recording from {RUNS} as r where state <> '{DONE}' and {named} and not exists "
        f"(select 1 from {RUNS} as later where later.source = r.source and later.state = '{DONE}' "
        "and later.finished > r.finished) group by state, regexp_replace(reason, '\\S*\\d\\S*', '#', 'g') "
        "order by count desc, recording",
        values,
    )
    return StoreSummary(totals, worst, failed)
