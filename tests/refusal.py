"""What the command line answers to a mistake."""

from replicate import __main__ as cli


def refused(capsys, *arguments: str) -> str:
    """Return the one sentence with which a command line is refused."""
    assert cli.main(list(arguments)) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "Traceback" not in said.err
    return said.err
