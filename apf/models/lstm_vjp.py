"""The passes of an LSTM written out, forwards and backwards: this is where its training spends its time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor, bmm
from torch.nn.functional import pad

from apf.models.layers import VJP, Backward, large_products
from apf.models.readout_vjp import readout_vjp

if TYPE_CHECKING:
    from apf.models.lstm import LSTMNetwork, Prepared

_sigmoid_backward = torch.ops.aten.sigmoid_backward.grad_input
_tanh_backward = torch.ops.aten.tanh_backward.grad_input
_MINUS_ONE = torch.tensor(-1.0)


def written_out(network: "LSTMNetwork") -> VJP:
    """What `LSTMNetwork.logits_of` computes, and its way back, for weights that stay where they are.

    Steps lie one after another in the rows of a few arrays, and a state is written where it is read: beside what the
    next step reads, and into the layer above.
    """
    parameters = [parameter.detach() for parameter in network.layers.parameters()]
    weights, biases = parameters[::2], parameters[1::2]
    members, hidden = len(weights[0]), network.hidden
    readout = readout_vjp(network.readout, network.logit)

    @torch.inference_mode()
    def vjp(prepared: "Prepared") -> tuple[Tensor, Backward]:
        rows, x = prepared.rows, prepared.x
        widths = [weight.shape[1] for weight in weights] + [hidden]
        read = [x.new_empty(members, sum(rows), width) for width in widths]
        read[0][..., : x.shape[2]] = x
        steps = [_read(*of_layer, rows) for of_layer in zip(read, read[1:], weights, biases, strict=False)]
        logits, readout_back = readout(ended(read[-1].split(rows, 1)), prepared.plans)

        @torch.inference_mode()
        def backward(gradient: Tensor) -> list[Tensor]:
            """In the order of the network's parameters; `g` is the gradient of one layer's states after another's."""
            g, of_readout = readout_back(gradient)
            g, of_layers = _ended_back(g, rows), list[Tensor]()
            for number in reversed(range(len(weights))):
                of_layer, g = _read_back(steps[number], read[number], g, weights[number], lowest=number == 0)
                of_layers = of_layer + of_layers
            return [*of_layers, *of_readout]

        return logits, backward

    return vjp


def ended(states: Sequence[Tensor]) -> Tensor:
    """Of the states [E, rows, H] after each step, those of the sequences that end with it, the last rows: [E, R, H]."""
    rows = [state.shape[1] for state in states]
    return torch.cat([state[:, going_on:] for state, going_on in zip(states, [*rows[1:], 0], strict=True)], 1)


def _ended_back(gradient: Tensor, rows: Sequence[int]) -> Tensor:
    """From the gradient [E, R, H] of what `ended` says to that of all states, [E, T x N, H]."""
    going_on = [*rows[1:], 0]
    parts = gradient.split([n - later for n, later in zip(rows, going_on, strict=True)], 1)
    return torch.cat([pad(part, (0, 0, later, 0)) for part, later in zip(parts, going_on, strict=True)], 1)


def tanh(x: Tensor) -> Tensor:
    """The hyperbolic tangent by way of the sigmoid, which is far faster than `torch.tanh`."""
    return torch.sigmoid(x * 2) * 2 - 1


@dataclass(frozen=True, eq=False)
class _Step:
    """What is kept of a step. gates: [E, rows, 4H] input, forget, output, candidate. cell, its tanh: [E, rows, H]."""

    x: Tensor
    gates: Tensor
    cell: Tensor
    squashed: Tensor


def _read(read: Tensor, written: Tensor, weight: Tensor, bias: Tensor, rows: Sequence[int]) -> list[_Step]:
    """A layer goes through the `rows` of each step.

    read: [E, T x N, width + H] what it reads and, last, its state, which it writes there for the next step, too.
    written: [E, T x N, H or more], its states, and what is not theirs.
    """
    hidden, steps = weight.shape[2] // 4, list[_Step]()
    width = weight.shape[1] - hidden
    read[:, : rows[0], width:] = 0  # there is no state yet
    inputs, outputs = read.split(rows, 1), written[..., :hidden].split(rows, 1)
    for number, (x, state) in enumerate(zip(inputs, outputs, strict=True)):
        gates = large_products(x, weight, bias) if steps else large_products(x[..., :width], weight[:, :width], bias)
        enter, forget, leave, candidate = _by_gate(gates)
        candidate.mul_(2)
        gates.sigmoid_()
        torch.add(_MINUS_ONE, candidate, alpha=2, out=candidate)
        cell = enter * candidate
        if steps:
            cell.addcmul_(forget, steps[-1].cell[:, : x.shape[1]])
        squashed = (cell * 2).sigmoid_()
        torch.add(_MINUS_ONE, squashed, alpha=2, out=squashed)
        torch.mul(leave, squashed, out=state)
        if number + 1 < len(rows):
            inputs[number + 1][..., width:] = state[:, : rows[number + 1]]
        steps.append(_Step(x, gates, cell, squashed))
    return steps


def _read_back(
    steps: Sequence[_Step], read: Tensor, of_states: Tensor, weight: Tensor, lowest: bool
) -> tuple[list[Tensor], Tensor]:
    """From the gradient [E, T x N, H] of a layer's states, which changes, to those of its weights and of what it read.

    lowest: the latter is of no use.
    """
    hidden, rows = weight.shape[2] // 4, [step.x.shape[1] for step in steps]
    width = weight.shape[1] - hidden
    of_gates = weight.new_empty(*read.shape[:2], 4 * hidden)
    parts = list(zip(steps, of_gates.split(rows, 1), of_states.split(rows, 1), strict=True))
    of_going_on: tuple[Tensor, Tensor] | None = None  # of the state and the cell that the next step goes on from
    for number, (step, g, of_state) in reversed(list(enumerate(parts))):
        enter, forget, leave, candidate = _by_gate(step.gates)
        of_enter, of_forget, of_leave, of_candidate = _by_gate(g)
        if of_going_on:
            of_state[:, : rows[number + 1]] += of_going_on[0]
        of_cell = of_state * leave
        _tanh_backward(of_cell, step.squashed, grad_input=of_cell)
        if of_going_on:
            of_cell[:, : rows[number + 1]] += of_going_on[1]
        torch.mul(of_cell, candidate, out=of_enter)
        torch.mul(of_state, step.squashed, out=of_leave)
        torch.mul(of_cell, enter, out=of_candidate)
        if number:
            torch.mul(of_cell, steps[number - 1].cell[:, : g.shape[1]], out=of_forget)
        else:
            of_forget.zero_()
        sigmoids, of_sigmoids = (gates[..., : 3 * hidden] for gates in (step.gates, g))
        _sigmoid_backward(of_sigmoids, sigmoids, grad_input=of_sigmoids)
        _tanh_backward(of_candidate, candidate, grad_input=of_candidate)
        if number:
            of_going_on = bmm(g, weight[:, width:].mT), of_cell.mul_(forget)
    of_read = of_gates if lowest else large_products(of_gates, weight[:, :width].mT)
    return [large_products(read.mT, of_gates), of_gates.sum(1, keepdim=True)], of_read


def _by_gate(x: Tensor) -> tuple[Tensor, ...]:
    """[..., 4H] -> four of [..., H]."""
    return x.view(*x.shape[:2], 4, -1).unbind(2)
