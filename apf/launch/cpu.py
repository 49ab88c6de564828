"""How a process uses the CPU and its memory."""

import ctypes
from contextlib import suppress

import torch

MIB = 2**20
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h of glibc


def set_up_cpu(threads: int) -> None:
    """Let torch compute on so many threads, and keep up to 256 MiB that are free for what is allocated next.

    Networks allocate and free the same few MiB again and again. glibc would hand these back to the system, now and then
    each time, and to fetch them again can take longer than to compute what they hold. Other libraries of C have no
    such settings.
    """
    torch.set_num_threads(threads)
    with suppress(AttributeError, OSError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_THRESHOLD, 32 * MIB)
        mallopt(_M_TRIM_THRESHOLD, 256 * MIB)
