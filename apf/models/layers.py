"""Layers of a whole ensemble: one weight stack [E, in, out], one matrix product for all members."""

import math
from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor, nn

from apf.domain import Domain

GAIN = math.sqrt(2)
"""Weights start so many times as large as in `nn.Linear`, by default. With the range of `nn.Linear`, a member gives the
same prediction for every plan during its first hundred updates; some members never leave that plateau."""


class EnsembleLinear(nn.Module):
    """E independent affine maps, one per member.

    Weights start uniform in +-gain/sqrt(fan_in), biases in +-1/sqrt(fan_in).

    Args:
        members: E, the number of maps.
        n_in: number of inputs of each map.
        n_out: number of outputs of each map.
        fan_in: number of inputs that decides the initial range; by default all.
    """

    def __init__(self, members: int, n_in: int, n_out: int, fan_in: int | None = None) -> None:
        super().__init__()
        self.bound = 1 / math.sqrt(fan_in or n_in)
        self.weight = nn.Parameter(torch.empty(members, n_in, n_out))
        self.bias = nn.Parameter(torch.empty(members, 1, n_out))

    def reset(self, member: int, generator: torch.Generator, gain: float = GAIN) -> None:
        """Draw the initial weights of one member, on the CPU: every device gets the same.

        Args:
            member: number of the member.
            generator: of this member alone.
            gain: how large weights start.
        """
        for stack, bound in ((self.weight, gain * self.bound), (self.bias, self.bound)):
            part = stack.data[member]
            part.copy_(torch.empty(part.shape).uniform_(-bound, bound, generator=generator))

    def forward(self, x: Tensor) -> Tensor:
        """[E, ..., in] -> [E, ..., out]."""
        return torch.baddbmm(self.bias, x.flatten(1, -2), self.weight).unflatten(1, x.shape[1:-1])


class EnsembleNetwork(nn.Module):
    """Base of every network: E members side by side, whose stacked parameters all begin with axis E.

    A sub-class makes its layers of `EnsembleLinear` and implements `forward`; autograd does the rest. It is constructed
    with `members`, `n_features` = F, and `n_position`, how many of the last features are a position.
    """

    for_domain: ClassVar[type[Domain] | None] = None
    """Whose features it knows; None: those of any domain will do."""
    kernel_of: ClassVar[str]
    """The network in `apf.models.kernels.KERNELS` whose kernel serves this very class, too, but no sub-class of it: for
    a graph network that differs in its `pair_features` alone."""

    @classmethod
    def check_features(cls, domain: Domain) -> None:
        """Raises InputError if this network cannot read the features of such a domain; by default it reads any."""

    def forward(self, x: Tensor, last_only: bool = False) -> Tensor:
        """Logits that each prefix of 2..K placements is feasible, given that the prefixes before it were.

        Args:
            x: [E, N, K, F] features of K placements in N plans, for each member; the first placement comes first.
            last_only: compute the logit of the whole plan alone.

        Returns:
            [E, N, K - 1], or [E, N, 1] if `last_only`.
        """
        raise NotImplementedError

    def split(self, vector: Tensor) -> list[Tensor]:
        """Views of a vector that holds a number for each weight of some members, shaped as the parameters are."""
        sizes = [parameter[0].numel() for parameter in self.parameters()]
        members = len(vector) // sum(sizes)
        parts = vector.split([members * size for size in sizes])
        return [part.view(members, *p.shape[1:]) for part, p in zip(parts, self.parameters(), strict=True)]

    def use(self, vector: Tensor) -> None:
        """Make the parameters views of a vector: to an optimiser all weights are then one tensor."""
        for parameter, weight in zip(self.parameters(), self.split(vector), strict=True):
            parameter.data = weight

    def reset(self, generators: Sequence[torch.Generator], gain: float = GAIN) -> None:
        """Draw all initial weights.

        Args:
            generators: [E] one for each member.
            gain: how large weights start.
        """
        for layer in self.modules():
            if isinstance(layer, EnsembleLinear):
                for member, generator in enumerate(generators):
                    layer.reset(member, generator, gain)
