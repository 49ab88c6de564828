"""What every command shares: Hydra around it, and one line instead of a traceback for a user's mistake."""

import functools
import os
import sys
from collections.abc import Callable

from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from apf.errors import InputError

MISTAKES = (InputError, HydraException, OmegaConfBaseException)
_show_traceback = os.environ.get("HYDRA_FULL_ERROR") == "1"


def one_line_errors(job: Callable[[DictConfig], None]) -> Callable[[DictConfig], None]:
    """Decorates a Hydra job: a user's mistake in it ends the process with one line and exit code 1."""

    @functools.wraps(job)
    def wrapped(cfg: DictConfig) -> None:
        try:
            job(cfg)
        except MISTAKES as error:
            if _show_traceback:
                raise
            sys.exit(f"error: {one_line(error)}")  # Hydra lets SystemExit through, and adds no lines of its own

    return wrapped


def run_command(command: Callable[[], object]) -> None:
    """Run a Hydra command; a mistake in what it is to compose also ends in one line and exit code 1.

    Set HYDRA_FULL_ERROR=1 to see tracebacks.
    """
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then hands its exceptions on
    try:
        command()
    except MISTAKES as error:
        if _show_traceback:
            raise
        sys.exit(f"error: {one_line(error)}")
    except KeyboardInterrupt:
        sys.exit("interrupted")


def one_line(error: BaseException) -> str:
    """The message of an exception, folded into one line."""
    message = str(error).partition("\nConfig search path:")[0]
    lines = [line.strip() for line in message.splitlines()]
    kept = [line for line in lines if line and not line.startswith(("full_key:", "object_type="))]
    return " ".join(kept)
