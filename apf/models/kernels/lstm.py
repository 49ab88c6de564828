"""The passes of the LSTM written out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import torch
from torch import Tensor, baddbmm, bmm

from apf.models.kernels.readout import readout_vjp
from apf.models.lstm import sequences
from apf.models.passes import Backward, Passes

_MINUS_ONE = torch.tensor(-1.0)


@dataclass(frozen=True, eq=False)
class PreparedSequences:
    """The inputs of the first layer for N plans, step after step.

    x: [E, T x N, F] for T steps of sequences.
    rows: how many of T x N belong to each step. Sequences that begin at a step are its last rows.
    """

    plans: int
    rows: list[int]
    x: Tensor


class LSTMKernel(Passes):
    """The passes of training; the definition is as fast for predictions.

    All steps of a layer lie one after another in a few arrays, and states are written where they are read.
    """

    replayable = True
    parts = ("torch.ModuleList", "apf.EnsembleLSTM", "apf.EnsembleLinear", "torch.Sequential", "torch.ReLU")

    def batcher(self, x: Tensor, last_only: bool = False) -> Callable[[Tensor], PreparedSequences]:
        """As `Passes.batcher`: the inputs of each example lie in one row, so that a batch is one gather."""
        placements, counts = _placements(x.shape[1], last_only, x.device)
        by_plan = x.index_select(1, placements).flatten(1)

        def batch(rows: Tensor) -> PreparedSequences:
            e, n = rows.shape
            drawn = by_plan.index_select(0, rows.flatten()).view(e, n, len(placements), -1)
            return PreparedSequences(n, [count * n for count in counts], drawn.transpose(1, 2).flatten(1, 2))

        return batch

    @torch.inference_mode()
    def vjp(self, prepared: PreparedSequences) -> tuple[Tensor, Backward]:
        """As `Passes.vjp`."""
        *layers, weight, bias, last_weight, last_bias = self.parameters
        weights, biases = layers[::2], layers[1::2]
        rows, x, hidden = prepared.rows, prepared.x, weight.shape[1]
        widths = [layer.shape[1] for layer in weights] + [hidden]
        read = [x.new_empty(len(weight), sum(rows), width) for width in widths]
        read[0][..., : x.shape[2]] = x
        steps = [_forward(*of_layer, rows) for of_layer in zip(read, read[1:], weights, biases, strict=False)]
        final = read[-1][:, -rows[-1] :].unflatten(1, (-1, prepared.plans)).flip(1).flatten(1, 2)  # shortest first
        logits, readout_backward = readout_vjp(final, [weight, bias, last_weight, last_bias], prepared.plans)

        @torch.inference_mode()
        def backward(gradient: Tensor) -> list[Tensor]:
            """`g` is the gradient of one layer's states after another's."""
            of_final, readout_gradients = readout_backward(gradient)
            g = of_final.new_zeros(len(weight), sum(rows), hidden)
            g[:, -rows[-1] :].unflatten(1, (-1, prepared.plans)).copy_(
                of_final.unflatten(1, (-1, prepared.plans)).flip(1)
            )
            gradients: list[Tensor] = []
            for number in reversed(range(len(weights))):
                of_layer, g = _backward(steps[number], read[number], g, weights[number], lowest=number == 0)
                gradients = of_layer + gradients
            return [*gradients, *readout_gradients]

        return logits, backward


@lru_cache(maxsize=256)
def _placements(length: int, last_only: bool, device: torch.device) -> tuple[Tensor, list[int]]:
    """The placement that each sequence reads at each step, and the number of sequences at each step."""
    counts = sequences(length, last_only)
    steps = [[length - 1 - step] * count for step, count in enumerate(counts)]
    with torch.inference_mode(False):  # the cache serves training as well as prediction
        return torch.tensor(list(chain(*steps)), device=device), counts


@dataclass(frozen=True, eq=False)
class _Step:
    """What the way back needs of a step.

    gates: [E, rows, 4H] input, forget, output, candidate. cell, its tanh: [E, rows, H].
    """

    gates: Tensor
    cell: Tensor
    tanh: Tensor


def _forward(read: Tensor, written: Tensor, weight: Tensor, bias: Tensor, rows: Sequence[int]) -> list[_Step]:
    """All steps of a layer.

    Args:
        read: [E, T x N, width + H] the inputs, and last the state before each step, which is written here.
        written: [E, T x N, H or more] where the states are written, as first columns.
        weight: [E, width + H, 4H] of the gates.
        bias: [E, 1, 4H] of the gates.
        rows: how many of T x N belong to each step.
    """
    hidden, steps = weight.shape[2] // 4, list[_Step]()
    width = weight.shape[1] - hidden
    outputs = written[..., :hidden].split(rows, 1)
    for number, (x, state) in enumerate(zip(read.split(rows, 1), outputs, strict=True)):
        going_on = rows[number - 1] if number else 0
        if number:
            x[:, :going_on, width:] = outputs[number - 1]
        x[:, going_on:, width:] = 0  # sequences that begin here have no state yet
        gates = baddbmm(bias, x, weight) if number else baddbmm(bias, x[..., :width], weight[:, :width])
        enter, forget, leave, candidate = _by_gate(gates)
        candidate.mul_(2)  # tanh(x) = 2 sigmoid(2x) - 1, which is faster than torch.tanh
        gates.sigmoid_()
        torch.add(_MINUS_ONE, candidate, alpha=2, out=candidate)
        cell = enter * candidate
        if number:
            cell[:, :going_on].addcmul_(forget[:, :going_on], steps[-1].cell)
        tanh = (cell * 2).sigmoid_()
        torch.add(_MINUS_ONE, tanh, alpha=2, out=tanh)
        torch.mul(leave, tanh, out=state)
        steps.append(_Step(gates, cell, tanh))
    return steps


def _backward(
    steps: Sequence[_Step], read: Tensor, of_states: Tensor, weight: Tensor, lowest: bool
) -> tuple[list[Tensor], Tensor]:
    """The way back through all steps of a layer.

    Args:
        steps: what `_forward` returned.
        read: what `_forward` read.
        of_states: [E, T x N, H] the gradient of the layer's states, which is overwritten.
        weight: [E, width + H, 4H] of the gates.
        lowest: nobody needs the gradient of the inputs.

    Returns:
        The gradients of weight and bias, and the gradient of the inputs [E, T x N, width].
    """
    hidden, rows = weight.shape[2] // 4, [step.cell.shape[1] for step in steps]
    width = weight.shape[1] - hidden
    of_gates = weight.new_empty(*read.shape[:2], 4 * hidden)
    parts = list(zip(steps, of_gates.split(rows, 1), of_states.split(rows, 1), strict=True))
    of_next: tuple[Tensor, Tensor] | None = None  # of the state and the cell with which the next step goes on
    for number, (step, g, of_state) in reversed(list(enumerate(parts))):
        going_on = rows[number - 1] if number else 0
        enter, forget, leave, candidate = _by_gate(step.gates)
        of_enter, of_forget, of_leave, of_candidate = _by_gate(g)
        if of_next:
            of_state += of_next[0]
        of_cell = of_state * leave
        of_cell.addcmul_(of_cell * step.tanh, step.tanh, value=-1)
        if of_next:
            of_cell += of_next[1]
        torch.mul(of_cell, candidate, out=of_enter)
        torch.mul(of_state, step.tanh, out=of_leave)
        torch.mul(of_cell, enter, out=of_candidate)
        if number:
            torch.mul(of_cell[:, :going_on], steps[number - 1].cell, out=of_forget[:, :going_on])
        of_forget[:, going_on:] = 0
        sigmoids, of_sigmoids = (gates[..., : 3 * hidden] for gates in (step.gates, g))
        of_sigmoids.mul_(torch.addcmul(sigmoids, sigmoids, sigmoids, value=-1))
        of_candidate.addcmul_(of_candidate * candidate, candidate, value=-1)
        if number:
            of_next = bmm(g[:, :going_on], weight[:, width:].mT), of_cell[:, :going_on] * forget[:, :going_on]
    of_read = of_gates if lowest else bmm(of_gates, weight[:, :width].mT)
    return [bmm(read.mT, of_gates), of_gates.sum(1, keepdim=True)], of_read


def _by_gate(x: Tensor) -> tuple[Tensor, ...]:
    """[..., 4H] -> four of [..., H]."""
    return x.view(*x.shape[:2], 4, -1).unbind(2)
