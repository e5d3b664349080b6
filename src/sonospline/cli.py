"""The command line: one thin verb for each capability.

Data goes to stdout, progress and messages to stderr. Exit codes: 0 done, 1 failed,
2 bad input (one line: what, which value, what would be right).
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

from ._extras import MissingExtraError

VERBS = ("serve", "insert", "image", "tune", "reproduce", "bench", "doctor")

_POINT_OPTION = re.compile(r"--(entry|target|origin|look|right)")
_NEGATIVE = re.compile(r"-[\d.]")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return the exit code."""
    arguments = _join_negative_points(list(sys.argv[1:] if argv is None else argv))
    try:
        verbs = {name: import_module(f".commands.{name}", __package__) for name in _needed(arguments)}
    except ImportError as error:  # the environment asks for a core that is not there
        print(f"sonospline: {error}", file=sys.stderr)  # noqa: T201
        return 1
    args = _parser(verbs).parse_args(arguments)
    verb = verbs[args.verb]
    logging.basicConfig(level=logging.WARNING, format="sonospline: %(message)s", stream=sys.stderr)
    try:
        report = verb.run(args)
    except (ValueError, MissingExtraError, RuntimeError, OSError, MemoryError) as error:
        if args.traceback:
            raise
        print(f"sonospline {args.verb}: {error}", file=sys.stderr)  # noqa: T201
        return 2 if isinstance(error, ValueError) else 1
    except KeyboardInterrupt:
        return 130
    print(json.dumps(report, indent=2) if args.json else verb.describe(report, args))  # noqa: T201
    return 0


def _needed(arguments: Sequence[str]) -> Sequence[str]:
    """Return the verb that is asked for: to import the others takes longer than many a verb's work."""
    return arguments[:1] if arguments[:1] and arguments[0] in VERBS else VERBS


def _parser(verbs: dict[str, ModuleType]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
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


def _join_negative_points(arguments: list[str]) -> list[str]:
    """Turn ``--entry -1,2,3`` into ``--entry=-1,2,3``, which argparse does not take for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and _POINT_OPTION.fullmatch(joined[-1]) and _NEGATIVE.match(argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined
