"""The command line, which `make` calls: `python -m replicate <target>`."""

import argparse
import sys
from collections.abc import Sequence

from replicate.engine import paths, store
from replicate.engine.exceptions import InputError, RunError
from replicate.engine.make_options import without_foreign
from replicate.targets.options import OPTIONS
from replicate.targets.target_registry import Target, targets

EPILOG = """\
Artefacts are kept in .cache, or in $REPLICATE_CACHE, and reused for as long as their configuration, inputs and
sources stay the same. Exit codes: 0 done, 1 a stage failed or the disk is full, 2 bad input, 130 interrupted.
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        raise InputError(f"{message}; `{self.prog} --help` lists what is allowed")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one target and return its exit code; whoever made a mistake gets one sentence."""
    try:
        given = list(sys.argv[1:] if arguments is None else arguments)
        target = targets().get(given[0]) if given else None
        given = without_foreign(given, {f"--{option}" for option in target.options} if target else ())
        options = _parser().parse_args(given)
        options.typed = ["python", "-m", "replicate", *given]
        targets()[options.target].run(options)
    except (InputError, RunError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    except KeyboardInterrupt:
        print("interrupted: what is finished is kept, and the same command goes on from there", file=sys.stderr)
        return 130
    except OSError as error:
        if not store.is_disk_full(error):
            raise
        print(f"the disk is full ({error.filename or paths.ROOT}): make room and run the same command", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    plain = argparse.RawDescriptionHelpFormatter
    parser = _Parser("python -m replicate", description=__doc__, epilog=EPILOG, formatter_class=plain)
    subparsers = parser.add_subparsers(dest="target", required=True, metavar="target")
    for target in targets().values():
        about = target.about[0].upper() + target.about[1:] + "."
        subparser = subparsers.add_parser(
            target.name, help=target.about, description=about, epilog=EPILOG, formatter_class=plain
        )
        for option in target.options:
            subparser.add_argument(f"--{option}", **_settings(option, target))
    return parser


def _settings(option: str, target: Target) -> dict:
    """Return what argparse needs of an option, with the target's own characters as default."""
    settings = dict(OPTIONS[option])
    if option == "characters":
        settings["default"] = list(target.characters())
        settings["help"] += f" (default: {' '.join(target.characters())})"
    return settings


if __name__ == "__main__":
    sys.exit(main())
