"""Graph networks over the blocks of a tower: TGN and FCGN (Section Learning; Fig. architectures).

A prediction for every prefix of a plan comes from one pass. The message between two blocks does not depend on the
prefix that holds them, so each is computed once; a prefix then sums those whose blocks it holds.
"""

import sys
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from pathlib import Path

import torch
from pydantic import PositiveInt, validate_call
from torch import Tensor
from torch_geometric.nn import MessagePassing

from apf.models.layers import EnsembleLinear, EnsembleNetwork


@dataclass(frozen=True, eq=False)
class PrefixGraph:
    """Which messages each block of each prefix receives.

    A slot is a pair (prefix, block in it that hears from others); P edges, S slots, R prefixes, K blocks.
    edges: [2, P] (source, target). received: [S, P] 0/1, the edges into each slot from blocks of the same prefix.
    n_received: [S, 1, 1] how many they are. block: [S] the block of each slot. mean: [R, S] and mean_alone: [R, K]
    average a prefix over its slots and over its blocks that hear nothing.
    """

    edges: Tensor
    received: Tensor
    n_received: Tensor
    block: Tensor
    mean: Tensor
    mean_alone: Tensor


@lru_cache(maxsize=256)
def prefix_graph(length: int, both_ways: bool, whole: bool, device: torch.device) -> PrefixGraph:
    """The graph of plans of `length` placements, for prefixes 2..length, or for the whole plan alone.

    Edges run from every block above to each below it, or `both_ways` between all pairs.
    """
    edges = [(source, target) for source, target in permutations(range(length), 2) if both_ways or source > target]
    prefixes = [length] if whole else list(range(2, length + 1))
    slots = [(prefix, block) for prefix in prefixes for block in range(prefix if both_ways else prefix - 1)]
    received = [[target == block and source < prefix for source, target in edges] for prefix, block in slots]
    mean = [[(prefix == p) / prefix for p, _ in slots] for prefix in prefixes]
    alone = [[((p, block) not in slots and block < p) / p for block in range(length)] for p in prefixes]
    with torch.inference_mode(False):  # cached: training must be able to use what prediction made first
        to_received = torch.tensor(received, dtype=torch.float32, device=device)
        return PrefixGraph(
            torch.tensor(edges, device=device).T,
            to_received,
            to_received.sum(1).reshape(-1, 1, 1),
            torch.tensor([block for _, block in slots], device=device),
            torch.tensor(mean, dtype=torch.float32, device=device),
            torch.tensor(alone, dtype=torch.float32, device=device),
        )


class PrefixMessages(MessagePassing):
    """Messages along the edges of a `PrefixGraph`, summed for every slot. Arrays are [E, nodes, N, features].

    The message net has three layers, on both blocks' own features and on where the source lies as seen from the target.
    Its first is split into one product per block, and the two are added on each edge. Its last is linear and so is what
    a block's update does to the sum of messages: `last` and `to_update` act as one product, after the sum.
    """

    def __init__(self, members: int, n_own: int, n_position: int, hidden: int) -> None:
        super().__init__(aggr="sum", node_dim=-3)
        fan_in = 2 * n_own + n_position
        self.source = EnsembleLinear(members, n_own, hidden, bias=False, fan_in=fan_in)
        self.target = EnsembleLinear(members, n_own, hidden, fan_in=fan_in)
        self.position = EnsembleLinear(members, n_position, hidden, bias=False, fan_in=fan_in)
        self.middle = EnsembleLinear(members, hidden, hidden)
        self.last = EnsembleLinear(members, hidden, hidden)
        self.to_update = EnsembleLinear(members, hidden, hidden, bias=False, fan_in=n_own + hidden)

    def forward(self, own: Tensor, position: Tensor, graph: PrefixGraph) -> Tensor:
        """Own features [E, K, N, F - D] and positions [E, K, N, D] -> [E, S, N, H]: what each slot's update adds."""
        place = self.position(position)
        source, target = self.source(own) + place, self.target(own) - place
        total = self.propagate(graph.edges, source=source, target=target, received=graph.received)
        weight, bias = self.last.then(self.to_update)
        return torch.bmm(total.flatten(1, 2), weight).view_as(total) + graph.n_received * bias.unsqueeze(1)

    def message(self, source_j: Tensor, target_i: Tensor) -> Tensor:
        """[E, P, N, H]: one message per edge, up to its last layer."""
        return self.middle(source_j.add_(target_i).relu_()).relu_()

    def aggregate(self, inputs: Tensor, received: Tensor) -> Tensor:
        """[E, P, N, H] -> [E, S, N, H]: sums over the edges into each slot, as one product with a 0/1 matrix."""
        return mix_nodes(received, inputs)


def mix_nodes(weights: Tensor, x: Tensor) -> Tensor:
    """Weighted sums over nodes: [M, nodes] x [E, nodes, N, H] -> [E, M, N, H]."""
    return torch.matmul(weights, x.flatten(2)).unflatten(2, x.shape[2:])


class GraphNetwork(EnsembleNetwork):
    """One round of message passing, update of each block, mean over blocks, readout of two layers.

    Blocks see each other's positions as differences only: a tower is the same wherever it stands, and so is a pair of
    neighbours at any height of it.
    """

    both_ways: bool

    @validate_call
    def __init__(
        self, *, members: PositiveInt, n_features: PositiveInt, n_position: PositiveInt, hidden: PositiveInt
    ) -> None:
        super().__init__()
        self.n_own = n_own = n_features - n_position
        self.messages = PrefixMessages(members, n_own, n_position, hidden)
        if generated := sys.modules.get(f"{__name__}_PrefixMessages_propagate"):  # from a file that nobody cleans up
            Path(str(generated.__file__)).unlink(missing_ok=True)
        self.update = EnsembleLinear(members, n_own, hidden, fan_in=n_own + hidden)
        self.readout = EnsembleLinear(members, hidden, hidden)
        self.logit = EnsembleLinear(members, hidden, 1)

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `whole`; see `EnsembleNetwork.forward`."""
        x = x.transpose(1, 2)
        own, position = x[..., : self.n_own].contiguous(), x[..., self.n_own :].contiguous()
        graph = prefix_graph(x.shape[1], self.both_ways, whole, x.device)
        alone = self.update(own)
        slots = self.messages(own, position, graph).add_(alone.index_select(1, graph.block)).relu_()
        prefixes = mix_nodes(graph.mean, slots)
        if not self.both_ways:
            prefixes = prefixes + mix_nodes(graph.mean_alone, torch.relu(alone))
        return self.logit(self.readout(prefixes).relu_()).squeeze(-1).transpose(1, 2)


class TowersGraphNetwork(GraphNetwork):
    """TGN: each block hears from those above it, as the analytic rule compares them."""

    both_ways = False


class FullyConnectedGraphNetwork(GraphNetwork):
    """FCGN: the same networks, with messages between all pairs of blocks."""

    both_ways = True
