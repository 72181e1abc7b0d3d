"""The errors that end a command with one sentence instead of a traceback."""


class InputError(ValueError):
    """Bad input: one sentence that names the file, the key or index, what was expected and what was found.

    The command line prints the sentence alone and exits with code 2. Arguments, recipes and configuration files are
    checked before anything is written. Mistakes that only a stage can find, such as a recipe that gives no mesh, end
    the run without a result; what other stages have finished stays in the cache.
    """


class RunError(RuntimeError):
    """A run that could not go on, for a reason outside its input: a stage failed or was killed, or the disk is full.

    The command line prints the one sentence and exits with code 1; what was finished by then stays in the cache.
    """
