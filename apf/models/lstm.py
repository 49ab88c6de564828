"""The LSTM baseline: reads the blocks of a prefix from its top to the bottom (Section Learning)."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import cast

import torch
from pydantic import PositiveInt, validate_call
from torch import Tensor, nn

from apf.models.layers import VJP, EnsembleLinear, EnsembleNetwork, affine
from apf.models.lstm_vjp import ended, tanh, written_out
from apf.settings import Few, Width


@dataclass(frozen=True, eq=False)
class Prepared:
    """What the prefixes of N plans read: in the first step their tops, in the next the blocks below them, and so on.

    x: [E, T x N, F], step by step, those that last longest first; E is 1 where all members see the same plans.
    rows: how many of T x N each step has.
    """

    plans: int
    rows: list[int]
    x: Tensor


class LSTMNetwork(EnsembleNetwork):
    """A stack of LSTM layers from the top block to the bottom one, then a readout of two layers.

    Each prefix has a top of its own, and so is a sequence of its own; all of them run side by side.
    """

    @validate_call
    def __init__(
        self,
        *,
        members: Few,
        n_features: PositiveInt,
        n_position: PositiveInt,
        hidden: Width,
        layers: Few,
    ) -> None:
        super().__init__()
        self.hidden = hidden
        widths = [n_features] + [hidden] * (layers - 1)
        self.layers = nn.ModuleList(EnsembleLinear(members, n + hidden, 4 * hidden, fan_in=hidden) for n in widths)
        self.readout = EnsembleLinear(members, hidden, hidden)
        self.logit = EnsembleLinear(members, hidden, 1)

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `whole`; see `EnsembleNetwork.forward`."""
        return self.logits_of(self.prepare(x, whole))

    def prepare(self, x: Tensor, whole: bool = False) -> Prepared:
        """[E, N, K, F] -> what the layers read of them."""
        blocks, sizes = _blocks_read(x.shape[2], whole, x.device)
        by_step = x.transpose(1, 2).index_select(1, blocks).flatten(1, 2)
        return Prepared(x.shape[1], [size * x.shape[1] for size in sizes], by_step)

    def batcher(self, x: Tensor, whole: bool = False) -> Callable[[Tensor], Prepared]:
        """As `EnsembleNetwork.batcher`: what is read of an example lies side by side, to be gathered fast."""
        blocks, sizes = _blocks_read(x.shape[1], whole, x.device)
        by_plan = x.index_select(1, blocks).flatten(1)

        def batch(rows: Tensor) -> Prepared:
            e, n = rows.shape
            drawn = by_plan.index_select(0, rows.flatten()).view(e, n, len(blocks), -1)
            return Prepared(n, [size * n for size in sizes], drawn.transpose(1, 2).flatten(1, 2))

        return batch

    def logits_of(self, prepared: Prepared) -> Tensor:
        """[E, N, K - 1], or [E, N, 1] of the whole plans."""
        read = prepared.x.split(prepared.rows, 1)
        for layer in cast("Iterable[EnsembleLinear]", self.layers):
            states, cell = list[Tensor](), None
            for x in read:
                if cell is None:  # there is no state yet
                    gates = affine(x, layer.weight[:, : x.shape[2]], layer.bias)
                else:
                    state, cell = states[-1][:, : x.shape[1]], cell[:, : x.shape[1]]
                    gates = layer(torch.cat([x.expand(len(state), -1, -1), state], 2))
                sigmoids, candidate = gates.split([3 * self.hidden, self.hidden], 2)
                enter, forget, leave = torch.sigmoid(sigmoids).chunk(3, 2)
                new = enter * tanh(candidate)
                cell = new if cell is None else torch.addcmul(new, forget, cell)
                states.append(leave * tanh(cell))
            read = tuple(states)
        logits = self.logit(self.readout(ended(read), relu=True))
        return logits.view(len(logits), -1, prepared.plans).transpose(1, 2)

    def vjp(self) -> VJP:
        """As `EnsembleNetwork.vjp`, written out; a subclass that computes something else is left to autograd."""
        return written_out(self) if self.replayable else super().vjp()

    @property
    def replayable(self) -> bool:
        """As `EnsembleNetwork.replayable`: yes, unless a subclass computes something else."""
        return (type(self).batcher, type(self).logits_of) == (LSTMNetwork.batcher, LSTMNetwork.logits_of)


@lru_cache(maxsize=256)
def _blocks_read(length: int, whole: bool, device: torch.device) -> tuple[Tensor, list[int]]:
    """Which blocks the prefixes 2..length of a plan read, or the whole plan alone, and how many in each step."""
    tops = [length - 1] if whole else range(length - 1, 0, -1)
    steps = [[top - step for top in tops if top >= step] for step in range(length)]
    with torch.inference_mode(False):  # cached: training must be able to use what prediction made first
        return torch.tensor(list(chain(*steps)), device=device), [len(blocks) for blocks in steps]
