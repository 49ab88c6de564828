"""Which apf this is: its version, and the commit of its checkout."""

import functools
import subprocess
from dataclasses import dataclass
from pathlib import Path

from apf import __version__

WAIT = 10.0
"""Seconds that git may take."""


@dataclass(frozen=True)
class Commit:
    """The commit of a checkout. dirty: do its tracked files differ from the commit?"""

    hash: str
    dirty: bool

    def __str__(self) -> str:
        """Its first digits, as git shows them."""
        return self.hash[:7] + (", changed since" if self.dirty else "")


def version_line() -> str:
    """The line that `--version` prints."""
    commit = commit_of()
    return f"apf {__version__}" + (f" (commit {commit})" if commit else "")


@functools.cache
def commit_of(package: Path = Path(__file__).parent) -> Commit | None:
    """The commit of the checkout that a package lies in. None where git does not know the package, as in a wheel."""
    try:
        _git(package, "ls-files", "--error-unmatch", "__init__.py")
        commit = _git(package, "rev-parse", "HEAD")
        return Commit(commit, bool(_git(package.parent, "status", "--porcelain", "--untracked-files=no", "--", ".")))
    except (OSError, subprocess.SubprocessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=WAIT, check=True)
    return done.stdout.strip()
