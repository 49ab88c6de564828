"""Steps that a GPU repeats by itself, without being told each operation anew: CUDA graphs.

An update of a small ensemble is some sixty operations, each over before the next one has been started: the GPU waits
for Python. A CUDA graph holds these operations with the places in memory that they read and write, and starts as one.
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
    """Does what a step does, from a CUDA graph once the step has run with the same key and inputs of the same shapes.

    step: `step(key, *inputs)`. Besides its inputs it may read and write tensors that stay where they are in memory.
        What it does must follow from the key and the shapes alone: it may not wait for the GPU, look at values of
        tensors, or draw.
    """

    def __init__(self, step: Step) -> None:
        self.step = step
        self.pool: Any = None
        self.recordings: dict[Hashable, _Recording | None] = {}

    def __call__(self, key: Hashable, *inputs: Tensor) -> tuple[Tensor, ...]:
        """What the step returns, in tensors of its own."""
        known = (key, *(x.shape for x in inputs))
        if known not in self.recordings:  # the first time runs as it is: libraries then make what they make only once
            self.recordings[known] = None
            return self.step(key, *inputs)
        recording = self.recordings[known] or self._record(key, inputs)
        self.recordings[known] = recording
        for place, x in zip(recording.inputs, inputs, strict=True):
            place.copy_(x)
        recording.graph.replay()
        return tuple(output.clone() for output in recording.outputs)

    def _record(self, key: Hashable, inputs: tuple[Tensor, ...]) -> _Recording:
        """Note all operations of the step, without doing them. All graphs share the memory of what passes."""
        if self.pool is None:
            self.pool = torch.cuda.graph_pool_handle()
        places = tuple(x.clone() for x in inputs)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, pool=self.pool):
            outputs = self.step(key, *places)
        return _Recording(graph, places, outputs)
