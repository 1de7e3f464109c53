"""Options that take a word or none, and which words they take."""

from __future__ import annotations

from collections.abc import Callable, Sequence

# The value of each option where no word follows, and the test whether a word that follows belongs to it.
OPTIONAL: dict[str, tuple[str, Callable[[str], bool]]] = {
    "--json": ("-", lambda word: word == "-" or word.endswith(".json")),
    "--register": ("on", lambda word: word in ("auto", "on", "off")),
    "--rerun": ("viewer", lambda word: word.endswith(".rrd") or "://" in word),
}


def without_guessing(words: Sequence[str]) -> list[str]:
    """Return a command line in which these options take no word that is not for them, a recording's name say."""
    words = list(words)
    for k, word in enumerate(words):
        if word in OPTIONAL:
            alone, fits = OPTIONAL[word]
            if k + 1 == len(words) or not fits(words[k + 1]):
                words[k] = f"{word}={alone}"
    return words
