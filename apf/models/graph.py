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

from apf.imports import put_off
from apf.models.layers import EnsembleLinear, EnsembleNetwork

with put_off("torch._dynamo"):  # the compiler: two of five seconds of a start
    from torch_geometric.nn import MessagePassing


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


class PrefixMessages(MessagePassing):
    """Messages along the edges of a `PrefixGraph`, summed for every slot, all but their last layer.

    A message is a net of three layers on both blocks' own features and on where the source lies, seen from the target.
    """

    def __init__(self, members: int, n_own: int, n_position: int, hidden: int) -> None:
        super().__init__(aggr="sum", node_dim=-3)
        self.n_own = n_own
        self.first = EnsembleLinear(members, 2 * n_own + n_position, hidden)
        self.middle = EnsembleLinear(members, hidden, hidden)

    def forward(self, x: Tensor, graph: PrefixGraph) -> Tensor:
        """Features [E, K, N, F] -> [E, S, N x H]: what each slot receives."""
        return self.propagate(graph.edges, x=x, received=graph.received)

    def message(self, x_i: Tensor, x_j: Tensor) -> Tensor:
        """[E, P, N, F] of targets and of sources -> [E, P x N, H]."""
        n = self.n_own
        pair = torch.cat([x_j[..., :n], x_i[..., :n], x_j[..., n:] - x_i[..., n:]], -1)
        return self.middle(self.first(pair.flatten(1, 2)).relu_()).relu_()

    def aggregate(self, inputs: Tensor, received: Tensor) -> Tensor:
        """[E, P x N, H] -> [E, S, N x H]: sums over the edges into each slot, as one product with a 0/1 matrix."""
        return mix_nodes(received, inputs)


def mix_nodes(weights: Tensor, x: Tensor) -> Tensor:
    """Weighted sums over nodes: [M, nodes] x [E, nodes x N, H] -> [E, M, N x H]."""
    x = x.view(len(x), weights.shape[1], -1)
    return x * weights if weights.numel() == 1 else torch.bmm(weights.expand(len(x), -1, -1), x)


class GraphNetwork(EnsembleNetwork):
    """One round of message passing, update of each block, mean over blocks, readout of two layers.

    Blocks see each other's positions as differences only: a tower is the same wherever it stands, and so is a pair of
    neighbours at any height of it. The last layer of a message is linear, and so is what an update does to the sum of
    messages: `last` and `update_messages` act as one product, after the sum.
    """

    both_ways: bool

    @validate_call
    def __init__(
        self, *, members: PositiveInt, n_features: PositiveInt, n_position: PositiveInt, hidden: PositiveInt
    ) -> None:
        super().__init__()
        self.hidden = hidden
        self.n_own = n_own = n_features - n_position
        self.messages = PrefixMessages(members, n_own, n_position, hidden)
        if generated := sys.modules.get(f"{__name__}_PrefixMessages_propagate"):  # from a file that nobody cleans up
            Path(str(generated.__file__)).unlink(missing_ok=True)
        self.last = EnsembleLinear(members, hidden, hidden)
        self.update_messages = EnsembleLinear(members, hidden, hidden, bias=False, fan_in=n_own + hidden)
        self.update_own = EnsembleLinear(members, n_own, hidden, fan_in=n_own + hidden)
        self.readout = EnsembleLinear(members, hidden, hidden)
        self.logit = EnsembleLinear(members, hidden, 1)

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `whole`; see `EnsembleNetwork.forward`."""
        e, n, k, _ = x.shape
        x = x.transpose(1, 2).contiguous()
        graph = prefix_graph(k, self.both_ways, whole, x.device)
        weight, bias = self.last.then(self.update_messages)
        counted = torch.cat([self._own(x, graph.block), graph.n_received.expand(e, -1, n, 1)], -1)
        slots = self.update_own(counted.flatten(1, 2), bias)
        slots = slots.baddbmm_(self.messages(x, graph).view_as(slots), weight).relu_()
        if self.both_ways:
            prefixes = mix_nodes(graph.mean, slots)
        else:
            alone = self.update_own(self._own(x, graph.alone).flatten(1, 2)).relu_()
            prefixes = mix_nodes(graph.mean_alone, alone).baddbmm_(
                graph.mean.expand(e, -1, -1), slots.view(e, len(graph.block), -1)
            )
        logits = self.logit(self.readout(prefixes.view(e, -1, self.hidden)).relu_())
        return logits.view(e, -1, n).transpose(1, 2)

    def _own(self, x: Tensor, blocks: Tensor) -> Tensor:
        """[E, K, N, F] -> [E, len(blocks), N, F - D]: the blocks' own features, without positions."""
        return x.index_select(1, blocks)[..., : self.n_own]


class TowersGraphNetwork(GraphNetwork):
    """TGN: each block hears from those above it, as the analytic rule compares them."""

    both_ways = False


class FullyConnectedGraphNetwork(GraphNetwork):
    """FCGN: the same networks, with messages between all pairs of blocks."""

    both_ways = True
