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
_in_job = False


def one_line_errors(job: Callable[[DictConfig], None]) -> Callable[[DictConfig], None]:
    """Decorates a Hydra job: a user's mistake in it ends the process with one line and exit code 1."""

    @functools.wraps(job)
    def wrapped(cfg: DictConfig) -> None:
        global _in_job
        _in_job = True
        try:
            job(cfg)
        except MISTAKES as error:
            if _show_traceback:
                raise
            sys.exit(f"error: {one_line(error)}")  # Hydra lets SystemExit through, and adds no lines of its own

    return wrapped


def run_command(command: Callable[[], object]) -> None:
    """Run a Hydra command; whatever keeps it from starting its job also ends in one line and exit code 1.

    Set HYDRA_FULL_ERROR=1 to see tracebacks.
    """
    global _in_job
    _in_job = False
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then hands its exceptions on
    try:
        command()
    except KeyboardInterrupt:
        sys.exit("interrupted")
    except Exception as error:
        if _show_traceback or (_in_job and not isinstance(error, MISTAKES)):
            raise
        given = "" if isinstance(error, (*MISTAKES, OSError)) else f" (given: {' '.join(sys.argv[1:])})"
        sys.exit(f"error: {one_line(error)}{given}")


def one_line(error: BaseException) -> str:
    """The message of an exception, folded into one line, with the config key that it is about."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}"
    message = str(error).partition("\nConfig search path:")[0]
    lines = [line.strip() for line in message.splitlines()]
    kept = [line for line in lines if line and not line.startswith(("full_key:", "object_type=", "To append to"))]
    folded = " ".join(kept)
    key = str(getattr(error, "full_key", None) or "")
    return folded if key in folded else f"{key}: {folded}"
