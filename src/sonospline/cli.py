"""The command line: one thin verb for each capability.

Data goes to stdout, progress and messages to stderr. Exit codes: 0 done, 1 failed,
2 bad input (one line: what, which value, what would be right), 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import argparse
import json
import logging
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from types import ModuleType
from typing import Any, NoReturn

from . import _terminal

VERBS = (
    "serve", "link", "slicer-scene", "insert", "image", "record", "replay", "results", "dataset", "tune", "reproduce",
    "bench", "doctor",
)  # fmt: skip

_OPTION = re.compile(r"--[a-z][a-z-]*")
_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return the exit code."""
    try:
        with _terminal.signals_that_clean_up():
            return _run(_join_negative_numbers(list(sys.argv[1:] if argv is None else argv)))
    except KeyboardInterrupt:
        return 130


def _run(arguments: list[str]) -> int:
    args = None
    try:
        verbs = {name: import_module(f".commands.{name.replace('-', '_')}", __package__) for name in _needed(arguments)}
        args = _parser(verbs).parse_args(arguments)
        logging.basicConfig(level=logging.WARNING, format="sonospline: %(message)s", stream=sys.stderr)
        report = verbs[args.verb].run(args)
        _terminal.answer(json.dumps(report, indent=2) if args.json else verbs[args.verb].describe(report, args))
    except Exception as error:
        _terminal.leave_if_signalled(error)
        if args is not None and args.traceback:
            raise
        _terminal.say(f"sonospline{'' if args is None else f' {args.verb}'}: {_in_one_line(error)}")
        return 2 if isinstance(error, ValueError) else 1
    return 0


def _in_one_line(error: Exception) -> str:
    text = " ".join(str(error).splitlines()).strip()
    if isinstance(error, MemoryError):
        return f"out of memory ({text or 'no more was said'}); ask for less, or free some"
    if isinstance(error, (ValueError, ImportError, RuntimeError, OSError)):
        return text or type(error).__name__
    return f"a fault of Sonospline, please report it with what --traceback shows ({type(error).__name__}: {text})"


def _needed(arguments: Sequence[str]) -> Sequence[str]:
    """Return the verb that is asked for: to import the others takes longer than many a verb's work."""
    return arguments[:1] if arguments[:1] and arguments[0] in VERBS else VERBS


class _Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line, and does not mind a reader that leaves."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        (_terminal.answer if file is sys.stdout else _terminal.say)(message.removesuffix("\n"))


def _parser(verbs: dict[str, ModuleType]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="sonospline",
        description="Real-time tissue deformation under a needle. Not for clinical use.",
    )
    parser.add_argument("--version", action="version", version=f"sonospline {version('sonospline')}")
    choices = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for name, module in verbs.items():
        verb = choices.add_parser(
            name,
            help=module.HELP,
            description=module.HELP.capitalize() + ".",
            epilog=module.EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.add_argument("--traceback", action="store_true", help="show the full traceback of a failure")
        module.add_arguments(verb)
    return parser


def _join_negative_numbers(arguments: list[str]) -> list[str]:
    """Turn ``--entry -1,2,3`` into ``--entry=-1,2,3``, which argparse does not take for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and _OPTION.fullmatch(joined[-1]) and _NEGATIVE.match(argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined
