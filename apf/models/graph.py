"""Graph networks over the placements of a plan: TGN and FCGN (Section Learning; Fig. architectures)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import torch
from pydantic import NonNegativeInt, PositiveInt, validate_call
from torch import Tensor, nn

from apf.models.geometric import MeanAggregation, MessagePassing, OptTensor
from apf.models.layers import EnsembleLinear, EnsembleNetwork
from apf.settings import Few, Switch, Width


class PlacementConv(MessagePassing):
    """x_i' = ReLU(W [sum_j m(x_j, x_i, p_j - p_i, e_ij), x_i] + b): messages from placements j to i, and an update.

    The message m is a network of three layers. Positions p count as differences only, so a plan is the same
    wherever it stands; of a domain that counts them among the other features, D is 0. TGN and FCGN have no features e
    of a pair; a sub-class of `GraphNetwork` may have some.

    Args:
        members: E, the number of members.
        n_own: F, the number of features x of a placement without its position.
        n_position: D, the number of coordinates of a position p.
        hidden: H, the width of every layer.
        n_pair: P, the number of features e of a pair of placements.
        message_relu: does a ReLU follow the last layer of a message, too?
    """

    def __init__(
        self, members: int, n_own: int, n_position: int, hidden: int, n_pair: int = 0, message_relu: bool = False
    ) -> None:
        super().__init__(aggr="sum", node_dim=-3)
        self.message_net = nn.Sequential(
            EnsembleLinear(members, 2 * n_own + n_position + n_pair, hidden),
            nn.ReLU(),
            EnsembleLinear(members, hidden, hidden),
            nn.ReLU(),
            EnsembleLinear(members, hidden, hidden),
            *([nn.ReLU()] if message_relu else []),
        )
        self.update_net = nn.Sequential(EnsembleLinear(members, hidden + n_own, hidden), nn.ReLU())

    def forward(self, x: Tensor, position: Tensor, edge_index: Tensor, edge_attr: OptTensor = None) -> Tensor:
        """Pass messages once.

        Args:
            x: [E, V, N, F] features of V nodes in N plans.
            position: [E, V, N, D] their positions.
            edge_index: [2, A] source and target of each edge.
            edge_attr: [E, A, N, P] features of each edge's pair of placements; None if P is 0.

        Returns:
            [E, V, N, H] new features of the nodes.
        """
        return self.propagate(edge_index, x=x, position=position, edge_attr=edge_attr)

    def message(self, x_i: Tensor, x_j: Tensor, position_i: Tensor, position_j: Tensor, edge_attr: OptTensor) -> Tensor:
        """Features and positions of the edges' targets i and sources j [E, A, N, F or D] -> messages [E, A, N, H].

        Args:
            x_i: [E, A, N, F] features of the targets.
            x_j: [E, A, N, F] features of the sources.
            position_i: [E, A, N, D] positions of the targets.
            position_j: [E, A, N, D] positions of the sources.
            edge_attr: [E, A, N, P] features of the pairs; None if P is 0.
        """
        of_pair = [] if edge_attr is None else [edge_attr]
        return self.message_net(torch.cat([x_j, x_i, position_j - position_i, *of_pair], -1))

    def update(self, aggregated: Tensor, x: Tensor) -> Tensor:
        """Sums of messages [E, V, N, H], features [E, V, N, F] -> new features [E, V, N, H]."""
        return self.update_net(torch.cat([aggregated, x], -1))


@dataclass(frozen=True, eq=False)
class PrefixGraph:
    """The prefixes of a plan, side by side in one graph: each node is a placement in one of R prefixes.

    placement: [V] of each node. prefix: [V] 0..R - 1 of each node. edge_index: [2, A] source and target of each edge;
    both nodes of an edge belong to the same prefix.
    """

    placement: Tensor
    prefix: Tensor
    edge_index: Tensor


@lru_cache(maxsize=256)
def prefix_graph(length: int, both_ways: bool, last_only: bool, device: torch.device) -> PrefixGraph:
    """The graph of plans of one length.

    Args:
        length: K, the number of placements.
        both_ways: edges between all pairs of placements, instead of from each to those before it.
        last_only: for the whole plan alone, instead of for the prefixes of 2..K placements.
        device: where the tensors are to lie.
    """
    prefixes = [length] if last_only else range(2, length + 1)
    nodes = [(number, placement) for number, prefix in enumerate(prefixes) for placement in range(prefix)]
    edges = [
        (source, target)
        for source, (of_source, later) in enumerate(nodes)
        for target, (of_target, earlier) in enumerate(nodes)
        if of_source == of_target and (later > earlier or (both_ways and later != earlier))
    ]
    with torch.inference_mode(False):  # the cache serves training as well as prediction
        prefix, placement = torch.tensor(nodes, device=device).T.contiguous()
        return PrefixGraph(placement, prefix, torch.tensor(edges, device=device).T.contiguous())


class GraphNetwork(EnsembleNetwork):
    """One round of messages within each prefix, the mean over its placements, a readout of two layers.

    A sub-class gives messages further prior knowledge by `n_pair` and `pair_features`. `message_relu` puts a ReLU after
    the last layer of a message, too.
    """

    both_ways: bool
    n_pair: ClassVar[int] = 0
    """P: how many features `pair_features` computes of each pair of placements."""

    @validate_call
    def __init__(
        self,
        *,
        members: Few,
        n_features: PositiveInt,
        n_position: NonNegativeInt,
        hidden: Width,
        message_relu: Switch = False,
    ) -> None:
        super().__init__()
        self.message_relu = message_relu
        n_own = n_features - n_position
        self.sizes = [n_own, n_position]
        self.conv = PlacementConv(members, n_own, n_position, hidden, self.n_pair, message_relu)
        self.pool = MeanAggregation()
        self.readout = nn.Sequential(
            EnsembleLinear(members, hidden, hidden), nn.ReLU(), EnsembleLinear(members, hidden, 1)
        )

    def forward(self, x: Tensor, last_only: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `last_only`; see `EnsembleNetwork.forward`."""
        graph = prefix_graph(x.shape[2], self.both_ways, last_only, x.device)
        x = x.transpose(1, 2)
        own, position = x.index_select(1, graph.placement).split(self.sizes, -1)
        edge_attr = self.pair_features(x, graph.placement[graph.edge_index])
        nodes = self.conv(own, position, graph.edge_index, edge_attr)
        prefixes = self.pool(nodes, graph.prefix, dim=1, dim_size=1 if last_only else x.shape[1] - 1)
        return self.readout(prefixes).squeeze(-1).transpose(1, 2)

    def pair_features(self, x: Tensor, pairs: Tensor) -> Tensor | None:
        """What a message is told of its pair of placements, besides the features of each; by default nothing.

        Only what a prefix that ends with the pair's last placement holds may decide it.

        Args:
            x: [E, K, N, F] features of K placements in N plans.
            pairs: [2, A] placements that send and that receive a message.

        Returns:
            [E, A, N, P], or None if P is 0.
        """
        return None


class TGN(GraphNetwork):
    """The graph network with prior knowledge: a placement gets messages from all placements after it."""

    both_ways = False


class FCGN(GraphNetwork):
    """The fully connected graph network: a placement gets messages from all other placements."""

    both_ways = True
