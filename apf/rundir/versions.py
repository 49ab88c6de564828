"""What the numbers of a run depend on besides its config and seed: versions, and what the processor can do."""

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import torch

from apf import __version__

PACKAGES = ("torch", "torch-geometric", "numpy")


def versions() -> dict[str, str]:
    """Of this package, of Python, of the libraries that compute, and the instruction set that they compute with."""
    found = {"apf": __version__}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # of a library on Python's path alone
            found[name] = "not installed"
    found["torch"] = str(torch.__version__)  # says which build it is, too
    cpu = f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}"
    return {**found, "python": platform.python_version(), "cpu": cpu}


def changed(kept: Any) -> str | None:
    """One line on what differs from the versions that were kept when a run began; None: nothing does."""
    before, now = kept if isinstance(kept, Mapping) else {}, versions()
    differing = [
        f"{name} {before.get(name, 'unknown')} (now {now[name]})" for name in now if before.get(name) != now[name]
    ]
    if not differing:
        return None
    return f"begun with {', '.join(differing)}: going on, but not bit for bit as it would have been"
