"""The graph that the prefixes of a plan share: who hears from whom in which prefix."""

from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import permutations

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class PrefixGraph:
    """Which messages each block of each prefix receives.

    A slot is a block in a prefix; P edges, S slots, of which the first L hear from others, R prefixes.
    edges: [2, P] (source, target). received: [L, P] 0/1, the edges into each slot from blocks of its prefix.
    block: [S] the block of each slot. n_received: [S, 1, 1] how many edges. mean: [R, S] averages over slots.
    """

    edges: Tensor
    received: Tensor
    block: Tensor
    n_received: Tensor
    mean: Tensor


@lru_cache(maxsize=256)
def prefix_graph(length: int, both_ways: bool, whole: bool, device: torch.device) -> PrefixGraph:
    """The graph of plans of `length` placements, for prefixes 2..length, or for the whole plan alone.

    Edges run from every block above to each below it, or `both_ways` between all pairs.
    """
    edges = [(source, target) for source, target in permutations(range(length), 2) if both_ways or source > target]
    prefixes = [length] if whole else list(range(2, length + 1))
    slots = [(prefix, block) for prefix in prefixes for block in range(prefix if both_ways else prefix - 1)]
    received = [[target == block and source < prefix for source, target in edges] for prefix, block in slots]
    n_received = [sum(row) for row in received]
    if not both_ways:  # the top of a prefix hears nothing
        slots += [(prefix, prefix - 1) for prefix in prefixes]
        n_received += [0] * len(prefixes)
    mean = [[(prefix == p) / prefix for p, _ in slots] for prefix in prefixes]
    with torch.inference_mode(False):  # cached: training must be able to use what prediction made first
        number = partial(torch.tensor, dtype=torch.float32, device=device)
        return PrefixGraph(
            edges=torch.tensor(edges, device=device).T,
            received=number(received),
            block=torch.tensor([block for _, block in slots], device=device),
            n_received=number(n_received).reshape(-1, 1, 1),
            mean=number(mean),
        )


def mix_nodes(weights: Tensor, x: Tensor) -> Tensor:
    """Weighted sums over nodes: [M, nodes] x [E, nodes x N, H] -> [E, M x N, H].

    Weights of one node for one are those of a pair's only message, 1: x itself is returned.
    """
    if weights.numel() == 1:
        return x
    by_node = x.view(len(x), weights.shape[1], -1)
    return torch.bmm(weights.expand(len(x), -1, -1), by_node).view(len(x), -1, x.shape[2])
