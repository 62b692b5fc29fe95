"""The one exception that means: what was given cannot be used, and here is how to mend it."""


class InputError(ValueError):
    """A mistake in what the user gave: a file, a column, an option, an argument.

    The message is one line. It names the value received, where it was found (file, column, row)
    and the remedy. The command line prints it and exits with code 2, without a traceback.

    Args:
        message: the message; runs of white space, line breaks included, become single spaces.

    Example:
        >>> raise InputError("levels is 0: give a whole number of at least 2")
        Traceback (most recent call last):
        ...
        preisach_jax.errors.InputError: levels is 0: give a whole number of at least 2
    """

    def __init__(self, message: str):
        # Values quoted from a file may hold line breaks, and the command line promises one line.
        super().__init__(" ".join(str(message).split()))
