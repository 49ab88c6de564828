"""The exceptions whose message is all that a user needs to see: one line, and no traceback."""

from typing import Any

LONG = 60
"""Characters of a value that a line shows."""


class InputError(Exception):
    """A user's mistake. Its message names the key, file and row, and says what would be right, in one line."""


class Stopped(Exception):
    """A run cannot go on for now: its message says why, in one line. Nothing labelled is lost; it can be resumed."""


def shown(value: Any) -> str:
    """A value as one would type it, shortened if it is long."""
    words = {None: "null", True: "true", False: "false"}
    text = words[value] if value is None or isinstance(value, bool) else repr(value)
    return text if len(text) <= LONG else f"{text[: LONG - 4]} ..."
