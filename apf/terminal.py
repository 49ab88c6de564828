"""Where lines go that hold what a person typed: paths and names are printed as they are, never read as markup."""

import sys
from typing import IO

from rich.console import Console


def console(*, stderr: bool = False, width: int | None = None, file: IO[str] | None = None) -> Console:
    """A terminal that prints what it is told, to the letter.

    Rich would take `[red]` for a colour, `[/b]` for a mistake and `:tada:` for a picture, in lines as in tables.
    A long line is not broken: who copies a path from it gets the whole path.

    Args:
        stderr: to standard error, not to standard output.
        width: of a table, in characters; None: the terminal's.
        file: to write to in place of both.
    """
    return Console(stderr=stderr, width=width, file=file, markup=False, emoji=False, highlight=False, soft_wrap=True)


def accept_any_name() -> None:
    """Let standard output print file names that are no valid text, escaped, as standard error does."""
    reconfigure = getattr(sys.stdout, "reconfigure", None)  # what stands in for it in a test or a notebook has none
    if reconfigure is not None:
        reconfigure(errors="backslashreplace")
