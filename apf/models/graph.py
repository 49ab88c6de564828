"""Graph networks over the placements of a plan: TGN and FCGN (Section Learning; Fig. architectures)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import torch
from pydantic import NonNegativeInt, PositiveInt, validate_call
from torch import Tensor, nn

from apf.models.layers import EnsembleLinear, EnsembleNetwork
from apf.settings import Few, Switch, Width


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
        from apf.models.conv import PlacementConv  # here: torch-geometric takes two seconds to import, and a config is
        from apf.models.geometric import MeanAggregation  # checked before a network is made

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
