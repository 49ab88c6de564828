"""Interruptions of a run from outside: signals, a time limit, the end of the process that started the run."""

import contextlib
import faulthandler
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType

GRACE = 10.0
"""Seconds that native code, which no Python signal reaches, may go on after a time limit before the process ends."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM. Not an Exception: nothing but the end of the run should catch it."""

    def __init__(self, number: int, message: str = "interrupted") -> None:
        super().__init__(message)
        self.number = number


class TimeLimitError(Exception):
    """Something took longer than it may."""


def watch_signals() -> None:
    """From now on Ctrl-C and SIGTERM raise `Interrupted`, once; a second one ends the process at once."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        for signum in (signal.SIGINT, signal.SIGTERM):
            signal.signal(signum, signal.SIG_DFL)
        raise Interrupted(number)

    if threading.current_thread() is threading.main_thread():
        for signum in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(signum) is not signal.SIG_IGN:
                signal.signal(signum, interrupt)


def end_with_parent() -> None:
    """End as on SIGTERM when standard input closes: it is a pipe that the parent holds open while it lives."""

    def wait() -> None:
        while os.read(0, 1):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


@contextlib.contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Raises TimeLimitError in what takes longer; None: no limit. For the main thread.

    Native code that does not come back is ended with the process, a little later, showing where it hung.
    """
    if seconds is None:
        yield
        return

    def expire(number: int, frame: FrameType | None) -> None:
        raise TimeLimitError

    before = signal.signal(signal.SIGALRM, expire)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds)
        faulthandler.dump_traceback_later(seconds + GRACE, exit=True, file=2)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        faulthandler.cancel_dump_traceback_later()
