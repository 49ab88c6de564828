"""What every command shares: Hydra around it, and one line instead of a traceback for a user's mistake."""

import contextlib
import difflib
import functools
import os
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from apf.config.messages import no_such_key
from apf.config.values import config_dir
from apf.errors import InputError, Stopped
from apf.interrupts import Interrupted, end_with_parent, watch_signals
from apf.launch.help import ASKED, page
from apf.rundir.resume import quoted
from apf.source import version_line
from apf.terminal import accept_any_name

MISTAKES = (InputError, HydraException, OmegaConfBaseException)
ONE_LINE = (*MISTAKES, Stopped)
FOLLOWER = "APF_ENDS_WITH_PARENT"
"""Environment variable of a process that ends when its standard input closes."""
NOT_CHOSEN = r"Could not override '([^']*)'\. No match in the defaults list\.\nTo append to .* use \+[^=]*=(.*)"
"""Hydra's message about a config group that the defaults list does not hold."""
GRAMMAR = re.compile(
    r"LexerNoViableAlt|mismatched input|extraneous input|no viable alternative|token recognition error"
)
"""Messages of Hydra's parser about a text that its grammar does not accept."""
LONG = 200
"""Number of characters that a message shows of a very long word."""
_show_traceback = os.environ.get("HYDRA_FULL_ERROR") == "1"
_in_job = False


def one_line_errors(job: Callable[[DictConfig], Any]) -> Callable[[DictConfig], Any]:
    """Decorates a Hydra job: a user's mistake in the job ends the process with one line and exit code 1.

    In a sweep whose jobs share this process, a mistake does not end the other jobs: Hydra reports it after the last.
    """

    @functools.wraps(job)
    def wrapped(cfg: DictConfig) -> Any:
        global _in_job
        _in_job = True
        try:
            return job(cfg)
        except ONE_LINE as error:
            NewFolders.remove()
            if _show_traceback or HydraConfig.get().mode == RunMode.MULTIRUN:
                raise
            sys.exit(f"error: {one_line(error)}")  # Hydra lets SystemExit through, and adds no lines of its own

    return wrapped


def run_command(
    command: Callable[[], object], name: str, rewrite: Callable[[list[str]], list[str]] = lambda arguments: arguments
) -> None:
    """Run a Hydra command. An error before its job starts also ends in one line and exit code 1.

    HYDRA_FULL_ERROR=1 shows tracebacks.

    Args:
        command: What Hydra made of the job.
        name: Of the page that `--help` prints, in `conf/hydra/help`.
        rewrite: Changes the arguments before Hydra sees them.
    """
    global _in_job
    _in_job = False
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then hands its exceptions on
    try:
        if "--version" in sys.argv[1:] or sys.argv[1:] in ASKED:
            print(version_line() if "--version" in sys.argv[1:] else page(name), flush=True)
            return
        watch_signals()
        accept_any_name()
        if FOLLOWER in os.environ:
            end_with_parent()
        find_modules_here()
        sys.argv[1:] = rewrite(sys.argv[1:])  # may take folders from the path again
        command()
    except KeyboardInterrupt as error:
        print(str(error) or "interrupted", file=sys.stderr)
        sys.exit(128 + (error.number if isinstance(error, Interrupted) else 2))
    except BrokenPipeError:  # who reads what is printed has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Exception as error:
        NewFolders.remove()
        if _show_traceback or (_in_job and not isinstance(error, ONE_LINE)):
            raise
        given = "" if isinstance(error, (*ONE_LINE, OSError)) else f" (given: {' '.join(sys.argv[1:])})"
        sys.exit(f"error: {one_line(error)}{given}")


def find_modules_here() -> None:
    """Let a `_target_` name a module of the current folder, as `python -m` does.

    A console script does not look there by itself; jobs of a sweep and resumed runs, which are started by `python -m`,
    do, and the same command must mean the same everywhere. The folder comes last: nothing in it hides a library.
    """
    if not sys.flags.safe_path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))


class NewFolders(Callback):
    """Notes which folders Hydra makes for a run or a sweep, to take them back if it never begins."""

    missing: tuple[Path, ...] = ()
    """Innermost first."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Called before the run directory is made."""
        self.note(config.hydra.run)

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Called before the sweep directory is made."""
        self.note(config.hydra.sweep)

    @staticmethod
    def note(where: DictConfig) -> None:
        """What is missing of the path `where.dir` is not the user's."""
        NewFolders.missing = ()
        with contextlib.suppress(OmegaConfBaseException):  # a config that is wrong is told to the user later
            directory = Path(where.dir).absolute()
            NewFolders.missing = tuple(folder for folder in (directory, *directory.parents) if not folder.exists())

    @staticmethod
    def remove() -> None:
        """Remove the new folders that hold nothing but Hydra's note of a sweep."""
        for folder in NewFolders.missing:
            with contextlib.suppress(OSError):
                if [path.name for path in folder.iterdir()] == ["multirun.yaml"]:
                    (folder / "multirun.yaml").unlink()
                folder.rmdir()


def one_line(error: BaseException) -> str:
    """The message of an exception in one line that can be printed, with the config key that it is about.

    What a terminal would not show, or take for a command, is escaped; a word that fills the screen is cut.
    """
    line = re.sub(rf"(\S{{{LONG}}})\S{{{LONG},}}", r"\1 ...", _folded(error))
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def _folded(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}"
    cause = error.__cause__
    if isinstance(error, HydraException) and isinstance(cause, ConfigAttributeError | ConfigKeyError):
        return no_such_key(str(cause.full_key), cause.parent_node)
    if isinstance(error, OverrideParseException):
        return unreadable(error)
    message = str(error).partition("\nConfig search path:")[0]
    if added := re.fullmatch(NOT_CHOSEN, message):
        group, option = added.groups()
        if Path(config_dir(), group).is_dir():
            return f"{group}={option}: no {group} is chosen by default, so it is added with a plus: +{group}={option}"
    if isinstance(error, MissingConfigException) and "/" in (error.missing_cfg_file or ""):
        return no_such_option(str(error.missing_cfg_file), error.options or ())
    lines = [line.strip() for line in message.splitlines()]
    kept = [line for line in lines if line and not line.startswith(("full_key:", "object_type=", "To append to"))]
    folded = " ".join(kept)
    key = str(getattr(error, "full_key", None) or "")
    return folded if key in folded else f"{key}: {folded}"


def no_such_option(given: str, options: Sequence[str]) -> str:
    """One line on an option that a config group does not have: the one that was meant, and all that there are.

    Args:
        given: GROUP/OPTION.
        options: Of the group; empty if Hydra names none, as it does for a list of choices.
    """
    if "submitit" in given:
        return "hydra/launcher: Hydra's submitit launcher is not installed; pip install 'apf[slurm]'"
    group, _, option = given.rpartition("/")
    known = options or sorted(path.stem for path in Path(config_dir(), group).glob("*.yaml"))
    close = difflib.get_close_matches(option, known, n=1)
    meant = f"did you mean {close[0]}? " if close else ""
    return f"{group}={option}: there is no such option; {meant}{group} is one of {', '.join(known) or 'nothing here'}"


def unreadable(error: OverrideParseException) -> str:
    """One line on an argument that Hydra cannot read, and how to write it so that it can."""
    key, equals, value = error.override.partition("=")
    if not equals or not re.fullmatch(r"[+~]*[\w./@:-]+", key):
        return f"{error.override}: cannot be read; an argument is KEY=VALUE, as in seed=1"
    told = error.message.partition("\nSee https://hydra.cc")[0].partition(f"override '{error.override}'\n")[2]
    if told and not GRAMMAR.search(told):  # a function that is used wrongly, say: it tells why
        return f"{error.override}: cannot be read: {' '.join(told.split())}"
    return f"{error.override}: cannot be read; put the value in quotes, and all of it in others: {typed(key, value)}"


def typed(key: str, value: str) -> str:
    """How `key=value` is typed in a shell, for any value."""
    argument = f"{key}={quoted(value)}"
    return shlex.quote(argument) if re.search(r'["$`!\n]|\\\\', argument) else f'"{argument}"'
