"""The errors that end a command with one sentence instead of a traceback."""


class InputError(ValueError):
    """Bad input: one sentence that names the file, the key or index, what was found and what is allowed.

    The command line prints the sentence alone and exits with code 2. Arguments, recipes and configuration files are
    checked before anything is written; what shows only in a stage, such as a bad clip or a recipe that gives no mesh,
    ends the run with no result, and what other stages have finished by then stays in the cache.
    """


class RunError(RuntimeError):
    """A run that could not go on, for a reason outside its input: a stage failed or was killed, or the disk is full.

    The command line prints the one sentence and exits with code 1; what was finished by then stays in the cache.
    """
