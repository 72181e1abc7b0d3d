"""What the command line answers to a mistake."""

from replicate import __main__ as cli


def refusal(capsys, *arguments: str) -> str:
    """Return the one sentence with which a command line is refused."""
    assert cli.main(list(arguments)) == 2
    streams = capsys.readouterr()
    assert streams.out == "" and streams.err.count("\n") == 1 and "Traceback" not in streams.err
    return streams.err
