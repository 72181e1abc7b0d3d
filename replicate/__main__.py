"""The command line, which `make` calls: `python -m replicate <target>`."""

import sys
from collections.abc import Sequence

from replicate.base.command_line import guard, run


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one target and return its exit code; whoever made a mistake gets one sentence."""
    from replicate.cli.parser import command

    return guard(lambda: command(arguments))


if __name__ == "__main__":
    sys.exit(run("replicate.cli.parser:command"))
