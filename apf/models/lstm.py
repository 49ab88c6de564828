"""The LSTM baseline: reads the blocks of a prefix from its top to the bottom (Section Learning)."""

import torch
from pydantic import PositiveInt, validate_call
from torch import Tensor, nn

from apf.models.layers import EnsembleLinear, EnsembleNetwork


class LSTMNetwork(EnsembleNetwork):
    """A stack of LSTM layers from the top block to the bottom one, then a readout of two layers.

    Prefix i starts at block i, so every prefix is a sequence of its own. All run together: a step takes one block, and
    the prefix whose top it is joins those above it with a state of zero. What a block contributes to the gates
    of the first layer is the same for all prefixes, and computed once.
    """

    @validate_call
    def __init__(
        self,
        *,
        members: PositiveInt,
        n_features: PositiveInt,
        n_position: PositiveInt,
        hidden: PositiveInt,
        layers: PositiveInt,
    ) -> None:
        super().__init__()
        self.hidden = hidden
        widths = [n_features] + [hidden] * (layers - 1)
        self.inputs = nn.ModuleList(EnsembleLinear(members, n, 4 * hidden, fan_in=hidden) for n in widths)
        self.states = nn.ModuleList(
            EnsembleLinear(members, hidden, 4 * hidden, bias=False, fan_in=hidden) for _ in widths
        )
        self.readout = EnsembleLinear(members, hidden, hidden)
        self.logit = EnsembleLinear(members, hidden, 1)

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `whole`; see `EnsembleNetwork.forward`."""
        e, n, k, _ = x.shape
        gates_of = self.inputs[0](x.transpose(1, 2).reshape(e, k * n, -1)).view(e, k, n, -1)
        hidden = [x.new_zeros(e, 0, self.hidden) for _ in self.inputs]  # per layer, [E, running prefixes x N, H]
        cell = list(hidden)
        fresh = x.new_zeros(e, n, self.hidden)
        for block in reversed(range(k)):
            joins = block == k - 1 if whole else block > 0
            if joins:
                hidden = [torch.cat([fresh, h], 1) for h in hidden]
                cell = [torch.cat([fresh, c], 1) for c in cell]
            for layer in range(len(self.inputs)):
                if layer == 0:
                    gates = gates_of[:, block].repeat(1, hidden[0].shape[1] // n, 1)
                else:
                    gates = self.inputs[layer](hidden[layer - 1])
                if block < k - 1:  # at the top all states are zero
                    gates = gates.baddbmm_(hidden[layer], self.states[layer].weight)
                hidden[layer], cell[layer] = _lstm_cell(gates, cell[layer])
        logits = self.logit(self.readout(hidden[-1]).relu_())
        return logits.view(e, -1, n).transpose(1, 2)


def _lstm_cell(gates: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
    """Gates [..., 4H] (input, forget, output, candidate) and cell [..., H] -> new hidden and cell state [..., H]."""
    sigmoids, candidate = gates.split([3 * cell.shape[-1], cell.shape[-1]], -1)
    enter, forget, leave = torch.sigmoid(sigmoids).chunk(3, -1)
    cell = torch.addcmul(forget * cell, enter, torch.tanh(candidate))
    return leave * torch.tanh(cell), cell
