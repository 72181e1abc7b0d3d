"""The one kind of error that a user can mend by changing what they gave us."""


class InputError(ValueError):
    """Bad input: one sentence that names the file, the key or index, what was found and what is allowed.

    The command line prints the sentence alone and exits with code 2; nothing has been written by then.
    """
