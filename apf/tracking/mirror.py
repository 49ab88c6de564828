"""Mirrors by other libraries. If one fails, the run loses this mirror and goes on."""

import sys
from abc import abstractmethod
from dataclasses import field
from typing import Any, ClassVar

from apf.settings import settings
from apf.tracking.base import Metrics, RunFiles, RunInfo, Tracker

FAILURES = (Exception, SystemExit)
"""Errors that a library may raise, SystemExit included. Ctrl-C and signals are not among them."""


@settings
class Mirror(Tracker):
    """Shows a run by way of a library, and never costs the run. A resumed run shows its whole history again."""

    title: ClassVar[str]
    """What people call the library."""
    extra: ClassVar[str | None] = None
    """What to install: `pip install 'apf[EXTRA]'`; None: apf brings it."""
    _open: list[Any] = field(default_factory=list, init=False, repr=False)
    """What `open_run` returned, while the mirror works."""

    _shown: set[tuple[int, int]] = field(default_factory=set, init=False, repr=False)
    """Step and phase of what is shown: a resumed run trains its last model again, and tells its losses again."""

    @abstractmethod
    def open_run(self, run: RunInfo) -> Any:
        """What the run is shown by; None: nothing. It must not hold what `write` shows again. Raises anything."""

    @abstractmethod
    def write(self, opened: Any, metrics: Metrics) -> None:
        """Show metrics. Raises anything."""

    @abstractmethod
    def close(self, opened: Any, failed: bool) -> None:
        """The run ended. Raises anything."""

    def write_files(self, opened: Any, files: RunFiles) -> None:
        """Show what a finished run leaves behind. Raises anything."""

    def start(self, run: RunInfo) -> None:
        """As `Tracker.start`."""
        self._shown.clear()
        try:
            opened = self.open_run(run)
            if opened is not None:
                self._open.append(opened)
        except FAILURES as error:
            self._go_on_without(error)
        for metrics in run.history if self._open else ():
            self.log(metrics)

    def log(self, metrics: Metrics) -> None:
        """As `Tracker.log`."""
        phase = metrics.step, int(metrics.phase)
        if phase in self._shown:
            return
        self._shown.add(phase)
        for opened in tuple(self._open):
            try:
                self.write(opened, metrics)
            except FAILURES as error:
                self._go_on_without(error)

    def keep(self, files: RunFiles) -> None:
        """As `Tracker.keep`."""
        for opened in tuple(self._open):
            try:
                self.write_files(opened, files)
            except FAILURES as error:
                self._go_on_without(error)

    def finish(self, failed: bool) -> None:
        """As `Tracker.finish`; the next job of this process opens its own."""
        for opened in tuple(self._open):
            try:
                self.close(opened, failed)
            except FAILURES as error:
                self._go_on_without(error)
        self._open.clear()

    def _go_on_without(self, error: BaseException) -> None:
        self._open.clear()
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        if self.extra and isinstance(error, ModuleNotFoundError):
            reason = f"{error.name} is not installed; pip install 'apf[{self.extra}]'"
        print(f"{self.title} does not work, going on without it: {reason}", file=sys.stderr, flush=True)
