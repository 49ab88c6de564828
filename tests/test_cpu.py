"""Memory that is freed stays with the process."""

import ctypes
import subprocess
import sys

import pytest

KEPT = """
import ctypes, torch
from apf.launch.cpu import set_up_cpu

class Info(ctypes.Structure):
    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in names.split()]

mallinfo2 = ctypes.CDLL(None).mallinfo2
mallinfo2.restype = Info
{call}
parts = [torch.ones(2**18) for _ in range(100)]
del parts
print(mallinfo2().fordblks // 2**20)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="only glibc says what it keeps")
@pytest.mark.parametrize(("call", "kept"), [("set_up_cpu(1)", True), ("torch.set_num_threads(1)", False)])
def test_a_hundred_free_mebibytes_are_kept(call: str, kept: bool) -> None:
    command = [sys.executable, "-c", KEPT.format(call=call)]
    mebibytes = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert (mebibytes >= 100) is kept
