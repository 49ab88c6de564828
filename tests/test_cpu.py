"""Memory that is freed stays with the process."""

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource, torch
from apf.cpu import set_up_cpu
{call}
def work():
    parts = [torch.ones(2**19) for _ in range(4)]
for _ in range(5):
    work()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    work()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="settings of glibc")
def test_what_is_allocated_again_and_again_is_not_fetched_from_the_system_each_time() -> None:
    def faults(call: str) -> int:
        done = subprocess.run(
            [sys.executable, "-c", FAULTS.format(call=call)], check=True, capture_output=True, text=True
        )
        return int(done.stdout)

    assert faults("set_up_cpu(1)") < 2000 < faults("torch.set_num_threads(1)")
