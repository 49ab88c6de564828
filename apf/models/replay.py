"""CUDA graphs: a GPU records the operations of a step once, and then replays them.

An update of a small ensemble is some sixty operations. The GPU finishes each before Python has started the next.
A CUDA graph holds all operations with the places in memory that they read and write, and starts as one operation.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

Step = Callable[..., tuple[Tensor, ...]]
"""Takes a key and tensors, returns tensors."""


@dataclass(frozen=True, eq=False)
class _Recording:
    """A graph, and the tensors in which it finds its inputs and leaves its outputs."""

    graph: torch.cuda.CUDAGraph
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]


class Replayed:
    """A step that is replayed from a CUDA graph after its first run with the same key and inputs of the same shapes.

    Args:
        step: `step(key, *inputs)`. The step may read and write its inputs, and tensors that stay where they are in
            memory. Its operations must follow from the key and the shapes alone: the step may not wait for the GPU,
            read values of tensors, or draw random numbers.
    """

    def __init__(self, step: Step) -> None:
        self.step = step
        self.pool: Any = None
        self.recordings: dict[Hashable, _Recording | None] = {}

    def __call__(self, key: Hashable, *inputs: Tensor) -> tuple[Tensor, ...]:
        """The results of the step, in new tensors."""
        known = (key, *(x.shape for x in inputs))
        if known not in self.recordings:  # libraries allocate at the first run, which cannot be recorded
            self.recordings[known] = None
            return self.step(key, *inputs)
        recording = self.recordings[known] or self._record(key, inputs)
        self.recordings[known] = recording
        for place, x in zip(recording.inputs, inputs, strict=True):
            place.copy_(x)
        recording.graph.replay()
        return tuple(output.clone() for output in recording.outputs)

    def _record(self, key: Hashable, inputs: tuple[Tensor, ...]) -> _Recording:
        """Record all operations of the step. All graphs share the memory of intermediate results."""
        if self.pool is None:
            self.pool = torch.cuda.graph_pool_handle()
        places = tuple(x.clone() for x in inputs)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, pool=self.pool):
            outputs = self.step(key, *places)
        return _Recording(graph, places, outputs)
