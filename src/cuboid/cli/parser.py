"""The parser of the command line: its complaints are one line and name what was probably meant."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

from cuboid.core.errors import one_line

MISTAKE = 2
# More choices than this are not listed in a complaint.
LISTED = 8


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line.

    Attributes
    ----------
    example : str
        A call that works, which is shown where something is missing.
    """

    example = "cuboid demo"

    def error(self, message: str) -> NoReturn:
        """Print the complaint, and exit."""
        message = message.replace("-o/--output", "--output")
        shown = f"; for example: {self.example}" if "required: " in message else ""
        line = one_line(f"cuboid: error: {message}{shown} (see '{self.prog} --help')")
        self.exit(MISTAKE, f"{line}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            hint = did_you_mean(str(value), choices)
            listed = f" (choose from {', '.join(choices)})" if len(choices) <= LISTED or not hint else ""
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{hint}{listed}")

    def format_help(self) -> str:
        """Return the help; that of options which take a name lists the names."""
        for action in self._actions:
            names = getattr(action, "names", None)
            if names is not None and action.help:
                action.help = f"{action.help}: {_listed(names())}"
                del action.names  # type: ignore[attr-defined]
        return super().format_help()

    def refuse_unknown_options(self, words: Sequence[str]) -> None:
        """Exit with a complaint where an option does not exist, before one about what is missing."""
        options = set(self._options(words))
        for word in words:
            name = word.split("=")[0]
            if name in ("--", "-h", "--help"):
                return
            if name.startswith("--") and " " not in name and name not in options:
                self.error(f"unrecognized arguments: {name}{did_you_mean(name, options)}")

    def _options(self, words: Sequence[str]) -> Iterable[str]:
        """Iterate over all options, those of the chosen verb included."""
        yield from self._option_string_actions
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                for word in words:
                    if word in action.choices:
                        yield from action.choices[word]._option_string_actions
                        return


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint at the known word that is like a given one; an empty text where none is."""
    from difflib import get_close_matches

    known = sorted(known)
    near = get_close_matches(word, known, n=1) or [one for one in known if one.startswith(f"{word} ")][:1]
    return f"; did you mean '{near[0]}'?" if near else ""


def _listed(names: Iterable[str]) -> str:
    """Return names, each with its meaning where there are meanings, as a help lists them."""
    if isinstance(names, Mapping):
        return "; ".join(f"{name}, for {meaning}" for name, meaning in names.items()).replace("%", "%%")
    return ", ".join(names)


def takes_names(action: argparse.Action, names: Callable[[], Iterable[str]], *, ending: str = "") -> None:
    """Let the shell complete the names that an option takes, and its help list them.

    Parameters
    ----------
    action : argparse.Action
    names : callable
        Gives the names, or a mapping from them to their meanings; called only when they are needed, since that may
        import much.
    ending : str
        What follows a name, as "=" for NAME=VALUE.
    """
    action.names = names  # type: ignore[attr-defined]
    action.completer = lambda **_: [f"{name}{ending}" for name in names()]  # type: ignore[attr-defined]
