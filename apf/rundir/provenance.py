"""Where a run comes from: the commit of apf, the machine, and the time of day."""

import platform
import socket
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import torch

from apf.source import commit_of

CPUS = Path("/proc/cpuinfo")
"""Where Linux describes the processors."""


def provenance() -> dict[str, Any]:
    """Of a run that begins now. `source` is empty where apf lies in no git checkout, as when it comes from a wheel."""
    commit = commit_of()
    return {
        "source": {"commit": commit.hash if commit else None, "dirty": commit.dirty if commit else None},
        "machine": {"host": socket.gethostname(), "cpu": cpu_model(), "gpu": gpu_name()},
        "started": now(),
        "ended": None,
    }


def now() -> str:
    """The time of day, to the second, in UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def cpu_model(described: Path = CPUS) -> str:
    """What the processor is called; where the system does not tell, its architecture."""
    try:
        lines = described.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(filter(None, names), platform.processor() or platform.machine())


def gpu_name() -> str | None:
    """What the GPU that torch would take is called; None: there is none."""
    return torch.cuda.get_device_name() if torch.cuda.is_available() else None
