"""The exceptions whose message is all that a user needs to see: one line, and no traceback."""


class InputError(Exception):
    """A user's mistake. Its message names the key, file and row, and says what would be right, in one line."""


class Stopped(Exception):
    """A run cannot go on for now: its message says why, in one line. Nothing labelled is lost; it can be resumed."""
