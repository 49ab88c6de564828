"""A graph network that is told what the stability rule asks: where weight lies with respect to contact patches."""

import torch
from torch import Tensor

from apf.domain import Domain
from apf.errors import InputError
from apf.models.graph import TGN
from apf.towers.domain import TowerDomain
from apf.towers.features import COM, LENGTH, MEAN_SIDE, POSITION, SIDES


class ContactTGN(TGN):
    """TGN with a stronger inductive bias than the paper's: each message also holds four contact distances.

    A block i holds a prefix if the joint centre of mass of the blocks above i lies within the contact patch on i
    (`apf.towers.stability`). The joint centre is the mean, weighted by mass, of the centres of the blocks j above. So
    `contact_distances` of all pairs (i, j) are what the rule is made of. The paper's TGN has to learn them.
    """

    for_domain = TowerDomain
    n_pair = 4
    kernel_of = "apf.TGN"

    @classmethod
    def check_features(cls, domain: Domain) -> None:
        """As `EnsembleNetwork.check_features`: contact patches follow from positions from the bottom block."""
        if not isinstance(domain, TowerDomain) or not (domain.n_position and domain.length_unit == LENGTH):
            raise InputError(
                f"model is {cls.__name__}, which needs domain.position_of=bottom and domain.length_unit={LENGTH:g}"
            )

    def pair_features(self, x: Tensor, pairs: Tensor) -> Tensor:
        """As `GraphNetwork.pair_features`: the contact distances."""
        return contact_distances(x, pairs)


def contact_distances(x: Tensor, pairs: Tensor) -> Tensor:
    """How far inside the contact patch on a lower block the centre of mass of an upper block lies.

    The contact patch on block i is the rectangle in which block i + 1 overlaps the top of block i.

    Args:
        x: [E, K, N, N_FEATURES] features of K placements in N towers (`apf.towers.features`).
        pairs: [2, A] the upper and the lower block of each pair, as placements 0..K - 1.

    Returns:
        [E, A, N, 4] distances from the patch's edges at its least x, least y, greatest x and greatest y, in the unit of
        the features, 10 cm. Negative beyond an edge.
    """
    com, sides, position = (x[..., part][..., :2] for part in (COM, SIDES, POSITION))
    half = (sides + MEAN_SIDE) / 2
    low, high = position - half, position + half
    patch_low, patch_high = torch.maximum(low[:, :-1], low[:, 1:]), torch.minimum(high[:, :-1], high[:, 1:])
    upper, lower = pairs
    centre = (position + com).index_select(1, upper)
    return torch.cat([centre - patch_low.index_select(1, lower), patch_high.index_select(1, lower) - centre], -1)
