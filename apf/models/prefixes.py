"""The graph that the prefixes of a plan share: who hears from whom in which prefix."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class PrefixGraph:
    """Which messages each block of each prefix receives.

    A slot is a pair (prefix, block in it that hears from others); P edges, S slots, R prefixes.
    edges: [2, P] (source, target). received: [S, P] 0/1, the edges into each slot from blocks of the same prefix.
    n_received: [S, 1, 1] how many they are. block: [S] the block of each slot. mean: [R, S] averages over slots.
    alone: [A] blocks that hear nothing in a prefix, and mean_alone: [R, A] how much of its average they are.
    """

    edges: Tensor
    received: Tensor
    n_received: Tensor
    block: Tensor
    mean: Tensor
    alone: Tensor
    mean_alone: Tensor


@lru_cache(maxsize=256)
def prefix_graph(length: int, both_ways: bool, whole: bool, device: torch.device) -> PrefixGraph:
    """The graph of plans of `length` placements, for prefixes 2..length, or for the whole plan alone.

    Edges run from every block above to each below it, or `both_ways` between all pairs.
    """
    edges = [(source, target) for source, target in permutations(range(length), 2) if both_ways or source > target]
    prefixes = [length] if whole else list(range(2, length + 1))
    slots = [(prefix, block) for prefix in prefixes for block in range(prefix if both_ways else prefix - 1)]
    alone = [] if both_ways else [prefix - 1 for prefix in prefixes]
    received = [[target == block and source < prefix for source, target in edges] for prefix, block in slots]
    mean = [[(prefix == p) / prefix for p, _ in slots] for prefix in prefixes]
    mean_alone = [[(prefix - 1 == block) / prefix for block in alone] for prefix in prefixes]
    with torch.inference_mode(False):  # cached: training must be able to use what prediction made first

        def matrix(rows: list[list]) -> Tensor:
            return torch.tensor(rows, dtype=torch.float32, device=device)

        to_received = matrix(received)
        return PrefixGraph(
            edges=torch.tensor(edges, device=device).T,
            received=to_received,
            n_received=to_received.sum(1).reshape(-1, 1, 1),
            block=torch.tensor([block for _, block in slots], device=device),
            mean=matrix(mean),
            alone=torch.tensor(alone, dtype=torch.long, device=device),
            mean_alone=matrix(mean_alone),
        )


def mix_nodes(weights: Tensor, x: Tensor) -> Tensor:
    """Weighted sums over nodes: [M, nodes] x [E, nodes x N, H] -> [E, M, N x H]."""
    x = x.view(len(x), weights.shape[1], -1)
    return x * weights if weights.numel() == 1 else torch.bmm(weights.expand(len(x), -1, -1), x)
