"""One round of messages between the placements of a plan, by torch-geometric."""

import torch
from torch import Tensor, nn

from apf.models.geometric import MessagePassing, OptTensor
from apf.models.layers import EnsembleLinear


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
