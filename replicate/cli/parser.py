"""The command line: one command for each target, with its options."""

import argparse
import sys
import textwrap
from collections.abc import Sequence

from data_recipes.catalogue import forget_folders
from data_recipes.recipe_paths import OUTSIDE, check_function
from replicate.base.command_line import exit_in_words
from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import settle_folders
from replicate.base.signals import Stopped, without_foreign
from replicate.base.spelling import nothing_named
from replicate.cli.options import OPTIONS, characters
from replicate.cli.target_list import Target, targets

EPILOG = """\
Artefacts are kept in .cache, or in $REPLICATE_CACHE, and reused for as long as their configuration, inputs and
sources stay the same. Exit codes: 0 done, 1 a stage failed or the disk is full, 2 bad input, 130 interrupted.
"""

LONGEST = 600  # characters of argparse's messages, which repeat what was typed


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        raise InputError(f"{textwrap.shorten(message, LONGEST)}; `{self.prog} --help` lists the options")


def command(arguments: Sequence[str] | None = None) -> None:
    """Run the target that a command line names; raise InputError for a bad line, and whatever the target raises.

    arguments: the words after `python -m replicate`; None for those of this process.
    """
    settle_folders(*OUTSIDE.values())
    words = list(sys.argv[1:] if arguments is None else arguments)
    target = targets().get(words[0]) if words else None
    if words and not target and not words[0].startswith("-"):
        listed = "; `python -m replicate --help` lists them"
        raise InputError(nothing_named("target", words[0], targets(), listed))
    words = without_foreign(words, {f"--{option}" for option in target.options} if target else ())
    options = parser().parse_args(words)
    options.command_line = ["python", "-m", "replicate", *words]
    forget_folders()  # they may have changed since an earlier command of this process
    target = targets()[options.target]
    if target.asks_the_rig:
        check_function(characters(options), f"make {target.name}", target.asks_the_rig)
    try:
        target.run(options)
    except Stopped:
        raise
    except SystemExit as end:  # by a user's method, say; silence would look like success
        raise RunError(exit_in_words(end)) from None


def parser() -> argparse.ArgumentParser:
    """Return the parser of all targets' command lines."""
    plain, about = argparse.RawDescriptionHelpFormatter, "Make a table, a figure, or what belongs to them."
    top = _Parser("python -m replicate", description=about, epilog=EPILOG, formatter_class=plain)
    subparsers = top.add_subparsers(dest="target", required=True, metavar="target")
    for target in targets().values():
        about = target.about[0].upper() + target.about[1:] + "."
        subparser = subparsers.add_parser(
            target.name, help=target.about, description=about, epilog=EPILOG, formatter_class=plain
        )
        for option in target.options:
            subparser.add_argument(f"--{option}", **_settings(option, target))
    return top


def _settings(option: str, target: Target) -> dict:
    """Return argparse's arguments for an option; the target's characters and methods are the default."""
    settings = dict(OPTIONS[option])
    if option == "characters":
        settings["default"] = list(target.characters())
        settings["help"] += f" (default: {' '.join(target.characters())})"
    if option == "methods" and target.methods:
        settings["default"] = list(target.methods)
        settings["help"] = settings["help"].partition(" (default:")[0] + f" (default: {' '.join(target.methods)})"
    return settings
