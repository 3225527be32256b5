"""The one exception that users are meant to read."""


class SwingupError(Exception):
    """Bad input: the message is one line that names the value and the remedy.

    It is no ``ValueError``, so that nothing between the check and the command line rephrases it.
    """
