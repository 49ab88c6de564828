"""Graph networks over the blocks of a tower: TGN and FCGN (Section Learning; Fig. architectures).

A prediction for every prefix of a plan comes from one pass. The message between two blocks does not depend on the
prefix that holds them, so each is computed once; a prefix then sums those whose blocks it holds.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import torch
from pydantic import PositiveInt, validate_call
from torch import Tensor
from torch_geometric.nn import MessagePassing

from apf.models.layers import EnsembleLinear, EnsembleNetwork


@dataclass(frozen=True, eq=False)
class PrefixGraph:
    """Which messages each block of each prefix receives.

    A slot is a pair (prefix, block in it); P edges, S slots, R prefixes.
    edges: [2, P] (source, target). block: [S] the block of each slot. received: [S, P] 0/1, the edges into that block
    from blocks of the same prefix. mean: [R, S] averages the slots of each prefix.
    """

    edges: Tensor
    block: Tensor
    received: Tensor
    mean: Tensor


@lru_cache(maxsize=256)
def prefix_graph(length: int, both_ways: bool, whole: bool, device: torch.device) -> PrefixGraph:
    """The graph of plans of `length` placements, for prefixes 2..length, or for the whole plan alone.

    Edges run from every block above to each below it, or `both_ways` between all pairs.
    """
    edges = [(source, target) for source, target in permutations(range(length), 2) if both_ways or source > target]
    prefixes = [length] if whole else list(range(2, length + 1))
    slots = [(prefix, block) for prefix in prefixes for block in range(prefix)]
    received = [[target == block and source < prefix for source, target in edges] for prefix, block in slots]
    mean = [[(prefix == p) / prefix for p, _ in slots] for prefix in prefixes]
    with torch.inference_mode(False):  # cached: training must be able to use what prediction made first
        return PrefixGraph(
            torch.tensor(edges, device=device).T,
            torch.tensor([block for _, block in slots], device=device),
            torch.tensor(received, dtype=torch.float32, device=device),
            torch.tensor(mean, dtype=torch.float32, device=device),
        )


class PrefixMessages(MessagePassing):
    """Messages along the edges of a `PrefixGraph`, summed for every slot. Arrays are [E, nodes, N, features].

    The message net has three layers on both blocks' features. Its first is split into one product per block, and the
    two are added on each edge.
    """

    def __init__(self, members: int, n_features: int, hidden: int) -> None:
        super().__init__(aggr="sum", node_dim=-3)
        self.source = EnsembleLinear(members, n_features, hidden, bias=False, fan_in=2 * n_features)
        self.target = EnsembleLinear(members, n_features, hidden, fan_in=2 * n_features)
        self.middle = EnsembleLinear(members, hidden, hidden)
        self.last = EnsembleLinear(members, hidden, hidden)

    def forward(self, x: Tensor, graph: PrefixGraph) -> Tensor:
        """[E, K, N, F] -> [E, S, N, H]: what each slot receives."""
        return self.propagate(graph.edges, source=self.source(x), target=self.target(x), received=graph.received)

    def message(self, source_j: Tensor, target_i: Tensor) -> Tensor:
        """[E, P, N, H]: one message per edge."""
        return self.last(torch.relu(self.middle(torch.relu(source_j + target_i))))

    def aggregate(self, inputs: Tensor, received: Tensor) -> Tensor:
        """[E, P, N, H] -> [E, S, N, H]: sums over the edges into each slot, as one product with a 0/1 matrix."""
        return mix_nodes(received, inputs)


def mix_nodes(weights: Tensor, x: Tensor) -> Tensor:
    """Weighted sums over nodes: [M, nodes] x [E, nodes, N, H] -> [E, M, N, H]."""
    return torch.matmul(weights, x.flatten(2)).unflatten(2, x.shape[2:])


class GraphNetwork(EnsembleNetwork):
    """One round of message passing, update of each block, mean over blocks, readout of two layers."""

    both_ways: bool

    @validate_call
    def __init__(self, *, members: PositiveInt, n_features: PositiveInt, hidden: PositiveInt) -> None:
        super().__init__()
        self.messages = PrefixMessages(members, n_features, hidden)
        self.update_block = EnsembleLinear(members, n_features, hidden, fan_in=n_features + hidden)
        self.update_messages = EnsembleLinear(members, hidden, hidden, bias=False, fan_in=n_features + hidden)
        self.readout = EnsembleLinear(members, hidden, hidden)
        self.logit = EnsembleLinear(members, hidden, 1)

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `whole`; see `EnsembleNetwork.forward`."""
        x = x.transpose(1, 2).contiguous()
        graph = prefix_graph(x.shape[1], self.both_ways, whole, x.device)
        received = self.update_messages(self.messages(x, graph))
        blocks = torch.relu(self.update_block(x).index_select(1, graph.block) + received)
        prefixes = torch.relu(self.readout(mix_nodes(graph.mean, blocks)))
        return self.logit(prefixes).squeeze(-1).transpose(1, 2)


class TowersGraphNetwork(GraphNetwork):
    """TGN: each block hears from those above it, as the analytic rule compares them."""

    both_ways = False


class FullyConnectedGraphNetwork(GraphNetwork):
    """FCGN: the same networks, with messages between all pairs of blocks."""

    both_ways = True
