"""Checks whether a run fits its machine, before a plan is labelled or a file is written."""

import contextlib
import os
import sys
from pathlib import Path

import torch

from apf.domain import Domain
from apf.errors import InputError
from apf.models import EnsembleSettings
from apf.schema import Config

GIB = 2**30
PLACEMENT = 200
"""Approximate bytes of memory per placement while plans are drawn, judged and turned into features."""
ANSWER = 8
"""Bytes of one member's probability for one prefix."""
WEIGHT = 32
"""Bytes of memory per weight in training: the weight, its mean, its best value, its gradient, AdamW's state."""
LIMIT = Path("/sys/fs/cgroup/memory.max")
"""Where Linux says how much memory a container may take."""


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def memory(device: torch.device | None = None) -> int:
    """Bytes of memory of this machine or of a GPU; in a container, the container's limit."""
    if device is not None and device.type == "cuda":
        return int(torch.cuda.get_device_properties(device).total_memory)
    if not hasattr(os, "sysconf"):  # Windows does not tell: nothing is refused there
        return sys.maxsize
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(OSError, ValueError):  # no such limit, or `max`
        total = min(total, int(LIMIT.read_text()))
    return total


def check_machine(config: Config) -> None:
    """Raises InputError, naming the key, for more threads than cores, or more plans at once than memory holds."""
    if config.threads > cores():
        raise InputError(f"threads is {config.threads}; this machine has {cores()} cores for this process")
    answers = PLACEMENT + ANSWER * config.model.members
    longest = max(config.evaluation.lengths, default=0)
    for key, plans, length, each in (
        ("planner.candidates", config.planner.candidates, config.evaluation.length, PLACEMENT),
        ("sampler.candidates.n", getattr(config.sampler.candidates, "n", 0), config.sampler.max_length, answers),
        ("evaluation.test_plans", config.evaluation.test_plans, longest, answers),
    ):
        _check_memory(f"{key} is {plans}; plans of {length} placements", plans * length * each, memory())


def check_weights(settings: EnsembleSettings, domain: Domain, device: torch.device) -> None:
    """Raises InputError if the device cannot hold the networks while they are trained.

    Args:
        settings: The ensemble.
        domain: Of the plans.
        device: Where the networks are to be trained.
    """
    with torch.device("meta"):  # sizes without memory
        network = settings.network(members=1, n_features=domain.n_features, n_position=domain.n_position)
    weights = settings.members * sum(weight.numel() for weight in network.parameters())
    _check_memory(f"model: {settings.members} members of this network", WEIGHT * weights, memory(device))


def _check_memory(what: str, needed: int, there: int) -> None:
    if needed > there:
        raise InputError(f"{what} need about {needed / GIB:,.0f} GiB of memory; there are {there / GIB:,.1f}")
