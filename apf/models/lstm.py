"""The LSTM baseline: reads the placements of a prefix from its last to the first (Section Learning)."""

from collections.abc import Sequence

import torch
from pydantic import NonNegativeInt, PositiveInt, validate_call
from torch import Tensor, nn
from torch.nn.functional import pad

from apf.models.layers import EnsembleLinear, EnsembleNetwork
from apf.settings import Few, Width


class EnsembleLSTM(nn.Module):
    """One LSTM layer for each member; sequences may begin at different steps, and all end with the last step.

    Args:
        members: E, the number of members.
        n_in: F, the number of inputs at each step.
        hidden: H, the width of the state.
    """

    def __init__(self, members: int, n_in: int, hidden: int) -> None:
        super().__init__()
        self.gates = EnsembleLinear(members, n_in + hidden, 4 * hidden, fan_in=hidden)
        self.hidden = hidden

    def forward(self, steps: Sequence[Tensor]) -> list[Tensor]:
        """For each step, the inputs [E, R, N, F] of R sequences in N plans -> their states [E, R, N, H].

        R may grow from step to step: new sequences come last, and begin with a state of zeros.
        """
        first = steps[0]
        state = cell = first.new_zeros(len(first), 0, first.shape[2], self.hidden)
        states = []
        for x in steps:
            begin = x.shape[1] - state.shape[1]
            state, cell = (pad(old, (0, 0, 0, 0, 0, begin)) for old in (state, cell))
            enter, forget, leave, candidate = self.gates(torch.cat([x, state], -1)).chunk(4, -1)
            cell = torch.sigmoid(forget) * cell + torch.sigmoid(enter) * torch.tanh(candidate)
            state = torch.sigmoid(leave) * torch.tanh(cell)
            states.append(state)
        return states


class LSTMNetwork(EnsembleNetwork):
    """A stack of LSTM layers from the last placement to the first, then a readout of two layers.

    Each prefix begins with its own last placement, so each is a sequence of its own; all of them run side by side.
    """

    @validate_call
    def __init__(
        self,
        *,
        members: Few,
        n_features: PositiveInt,
        n_position: NonNegativeInt,
        hidden: Width,
        layers: Few,
    ) -> None:
        super().__init__()
        widths = [n_features] + [hidden] * (layers - 1)
        self.layers = nn.ModuleList(EnsembleLSTM(members, n, hidden) for n in widths)
        self.readout = nn.Sequential(
            EnsembleLinear(members, hidden, hidden), nn.ReLU(), EnsembleLinear(members, hidden, 1)
        )

    def forward(self, x: Tensor, last_only: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `last_only`; see `EnsembleNetwork.forward`."""
        by_step = x.transpose(1, 2).flip(1).split(1, 1)
        steps = [step.expand(-1, n, -1, -1) for step, n in zip(by_step, sequences(x.shape[2], last_only), strict=True)]
        for layer in self.layers:
            steps = layer(steps)
        return self.readout(steps[-1]).squeeze(-1).flip(1).transpose(1, 2)


def sequences(length: int, last_only: bool) -> list[int]:
    """How many prefixes of a plan of `length` placements have begun at each step, from the last placement on.

    Prefixes of one placement are left out, for they need no prediction.
    """
    return [1 if last_only else min(step, length - 1) for step in range(1, length + 1)]
