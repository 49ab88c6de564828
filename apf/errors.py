"""The one exception that means: the user's input is wrong, and this line says how."""


class InputError(Exception):
    """A user's mistake. Its message names the key, file and row, and says what would be right, in one line."""
