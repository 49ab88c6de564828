"""Layers of a whole ensemble: one weight stack [E, in, out], one matrix product for all members."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import repeat
from typing import Any

import torch
from torch import Tensor, nn

ONE_DNN = torch.ops.mkldnn._linear_pointwise if torch.backends.mkldnn.is_available() else None
"""oneDNN's x @ weight.T + bias and what follows it, as PyTorch's own compiler calls it; None where torch lacks it."""

GAIN = math.sqrt(2)
"""Weights start so many times as large as in `nn.Linear`. With its own, what a member says of any plan is the same for
the first hundred updates; some then never leave that plateau."""

LARGE = 1_500_000
"""Multiplications that make a product worth a call of its own."""


class EnsembleLinear(nn.Module):
    """E independent affine maps, one per member.

    Weights start uniform in +-GAIN/sqrt(fan_in), biases in +-1/sqrt(fan_in).
    last_is_one: the last of the n_in inputs is always 1, so that the last row of the weights is a bias.
    fan_in: number of inputs that decides the initial range, where a layer on concatenated inputs is split
    into one `EnsembleLinear` per input; by default all but a 1.
    """

    def __init__(
        self,
        members: int,
        n_in: int,
        n_out: int,
        *,
        bias: bool = True,
        last_is_one: bool = False,
        fan_in: int | None = None,
    ) -> None:
        super().__init__()
        self.n_varying = n_in - last_is_one
        self.bound = 1 / math.sqrt(fan_in or self.n_varying)
        self.weight = nn.Parameter(torch.empty(members, n_in, n_out))
        self.bias = nn.Parameter(torch.empty(members, 1, n_out)) if bias and not last_is_one else None

    def reset(self, member: int, generator: torch.Generator) -> None:
        """Draw the initial weights of one member from its own generator, on the CPU: every device gets the same."""
        weight, last = self.weight.data[member].tensor_split([self.n_varying])
        bias = last if self.bias is None else self.bias.data[member]
        for part, bound in ((weight, GAIN * self.bound), (bias, self.bound)):
            part.copy_(torch.empty(part.shape).uniform_(-bound, bound, generator=generator))

    def forward(self, x: Tensor, more: Tensor | None = None, relu: bool = False) -> Tensor:
        """[E, N, in], or [1, N, in] for all members -> [E, N, out], a new tensor that may be changed in place.

        more: [E, m, out] weights of m further inputs, which are the last of x.
        """
        return affine(x, self.weight if more is None else torch.cat([self.weight, more], 1), self.bias, relu)


def affine(x: Tensor, weight: Tensor, bias: Tensor | None = None, relu: bool = False) -> Tensor:
    """[E, N, in], or [1, N, in] for all members; [E, in, out]; [E, 1, out] -> [E, N, out], with a ReLU if asked for.

    One member that learns nothing is asked by oneDNN, which is faster than `bmm` where there is AVX-512.
    """
    if ONE_DNN and len(weight) == 1 and x.device.type == "cpu" and not torch.is_grad_enabled():
        return ONE_DNN(x, weight[0].mT, None if bias is None else bias[0, 0], "relu" if relu else "none", [], "")
    if len(x) < len(weight):
        x = x.expand(len(weight), -1, -1)
    y = torch.bmm(x, weight) if bias is None else torch.baddbmm(bias, x, weight)
    return y.relu_() if relu else y


def large_products(a: Tensor, b: Tensor, bias: Tensor | None = None) -> Tensor:
    """[E, n, m] @ [E, m, p] + [E, 1, p] -> [E, n, p], by oneDNN where each product is worth a call of its own."""
    if not ONE_DNN or a.device.type != "cpu" or a[0].numel() * b.shape[2] < LARGE:
        return torch.bmm(a, b) if bias is None else torch.baddbmm(bias, a, b)
    of_members = zip(a.unbind(), b.mT.unbind(), bias.squeeze(1).unbind() if bias is not None else repeat(None))
    return torch.stack([ONE_DNN(x, weight, of_bias, "none", [], "") for x, weight, of_bias in of_members])


Backward = Callable[[Tensor], Sequence[Tensor]]
"""From the gradient of an output to those of the parameters, in their order."""

VJP = Callable[[Any], tuple[Tensor, Backward]]
"""Vector-Jacobian product: from prepared plans to logits, and the way back from there."""


class EnsembleNetwork(nn.Module):
    """Base of every network: E members side by side, whose stacked parameters all begin with axis E.

    Sub-classes implement `forward`. A network sees a plan as features [K, F] of its placements, bottom first. It
    is made with `members`, `n_features` = F, and `n_position`, how many of the last features are a position.
    """

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """Logits that each prefix of 2..K placements is feasible, given that those before it were.

        x: [E, N, K, F]. Returns [E, N, K - 1], or [E, N, 1], the last of them alone, if `whole`.
        """
        raise NotImplementedError

    def prepare(self, x: Tensor, whole: bool = False) -> Any:
        """What `logits_of` needs to know of plans x [E, N, K, F], or [1, N, K, F] to show all members the same.

        A network may compute here what no weight has part in: members asked one after another then share it.
        """
        return x, whole

    def batcher(self, x: Tensor, whole: bool = False) -> Callable[[Tensor], Any]:
        """Of examples x [M, K, F]: what prepares those that each member is shown, given their rows [E, B]."""
        return lambda rows: self.prepare(x[rows], whole)

    def logits_of(self, prepared: Any) -> Tensor:
        """What all members say of prepared plans; as `forward`."""
        x, whole = prepared
        return self(x.expand(len(next(self.parameters())), -1, -1, -1), whole)

    def vjp(self) -> VJP:
        """What `logits_of` says of each member's own plans, and the way back; it holds until `use` moves the weights.

        By autograd; a network may know a faster way.
        """
        parameters = list(self.parameters())

        def vjp(prepared: Any) -> tuple[Tensor, Backward]:
            with torch.enable_grad():
                logits = self.logits_of(prepared)
            return logits.detach(), partial(torch.autograd.grad, logits, parameters, materialize_grads=True)

        return vjp

    @property
    def replayable(self) -> bool:
        """Do the functions of `batcher` and `vjp` repeat the same operations for inputs of the same shapes, whatever
        the values are, without waiting for the device? Then a GPU repeats a whole update by itself (`Replayed`).
        """
        return False

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

    def reset(self, generators: list[torch.Generator]) -> None:
        """Draw all initial weights; member e from `generators[e]` alone."""
        for layer in self.modules():
            if isinstance(layer, EnsembleLinear):
                for member, generator in enumerate(generators):
                    layer.reset(member, generator)
