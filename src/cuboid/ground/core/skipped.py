"""Frames that cannot be used, by the kind of reason."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SkippedKind:
    """Frames that were skipped for the same kind of reason.

    Attributes
    ----------
    frame : int
        The first of these frames.
    reason : str
        Reason for which the first one was skipped.
    count : int
        Number of these frames.
    """

    frame: int
    reason: str
    count: int


def skipped_kinds(skipped: Iterable[tuple[int, str]]) -> list[SkippedKind]:
    """Return the kinds of bad frames, the most frequent first, from the frames, in order, and their reasons.

    Reasons that differ only in words with digits (file names, numbers, sizes) are one kind.
    """
    kinds: dict[str, list[tuple[int, str]]] = {}
    for frame, reason in skipped:
        kinds.setdefault(re.sub(r"\S*\d\S*", "#", reason), []).append((frame, reason))
    found = [SkippedKind(*frames[0], len(frames)) for frames in kinds.values()]
    return sorted(found, key=lambda kind: (-kind.count, kind.frame))


def kind_lines(kinds: Sequence[SkippedKind]) -> list[str]:
    """Return a line about each kind: its first frame, the number of the others, and the reason."""
    more = (f" and {kind.count - 1} more like it" if kind.count > 1 else "" for kind in kinds)
    return [f"  frame {kind.frame}{others}: {kind.reason}" for kind, others in zip(kinds, more, strict=True)]
