"""Reads the command line of each program of heronry; reports a mistake in one sentence, with the closest spelling.

argparse alone answers a mistake with the whole usage and with names of its own types. This parser says what is wrong,
what the user may have meant and where help is. It then ends the program with exit code 2, as for any other input that
cannot be used. An option has one spelling. A shortened option is a mistake too: a script that uses one would fail as
soon as a new option begins with the same letters.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, NoReturn

from heronry_wire.spelling import close, meant

_NOT_READ = re.compile(r"invalid (\w+) value: (.*)")
_LACKS = re.compile(r"\b(is|are) required\b")
_MISSING = re.compile(r"the following arguments are required: (.*)")


class CommandParser(argparse.ArgumentParser):
    """A parser that reports a mistake in one sentence and exit code 2, and keeps the line breaks of its epilog."""

    _given: Sequence[str] = ()  # the words of the command line that are being read

    def __init__(self, *arguments: Any, **options: Any) -> None:
        options.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(*arguments, **{**options, "allow_abbrev": False})

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse as argparse does, but end the program with an error at an unknown argument."""
        self._given = sys.argv[1:] if args is None else args
        known, left = super().parse_known_args(args, namespace)
        if left:
            self.error(self._unknown(left))
        return known, left

    def error(self, message: str) -> NoReturn:
        """End the program with exit code 2 and one sentence.

        An argument may be missing because an option is misspelt; then the sentence names that option.
        """
        if _LACKS.search(message):
            message = self._misspelt() or message
        said = _NOT_READ.sub(lambda found: f"{found[2]} is not a {_kind(found[1])}", message)
        said = _MISSING.sub(lambda found: f"{found[1]} {'are' if ',' in found[1] else 'is'} missing", said)
        see = "" if "; " in said else f"; see '{self.prog} --help'"  # what follows a semicolon is a remedy
        self.exit(2, f"{self.prog}: {said.removeprefix('argument ')}{see}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            if action.nargs == argparse.PARSER:  # a command among those of a command
                raise argparse.ArgumentError(None, f"there is no command '{value}'; {meant(str(value), known)}")
            raise argparse.ArgumentError(action, f"'{value}' is none of the choices; {meant(str(value), known)}")

    def _misspelt(self) -> str | None:
        """Return a sentence about the first unknown option that resembles a known one; None if no option does."""
        names = (word.partition("=")[0] for word in self._given if word.startswith("--") and word != "--")
        said = (self._unknown([name]) for name in names if name not in self._option_string_actions)
        return next((sentence for sentence in said if "; did you mean" in sentence), None)

    def _unknown(self, left: Sequence[str]) -> str:
        option = next((word.partition("=")[0] for word in left if word.startswith("-") and word != "-"), None)
        if option is None:
            return f"'{left[0]}' is one argument too many"
        shown = [name for action in self._actions if action.help != argparse.SUPPRESS for name in action.option_strings]
        found = close(option, shown)
        return f"there is no option {option}" + (f"; did you mean {found}?" if found else "")


def program_version() -> str:
    """Return the version of heronry that is installed."""
    return version("heronry")


def _kind(type_name: str) -> str:
    return "whole number" if type_name in ("int", "whole_number") else "number"
