"""The readout of every network, two layers, written out forwards and backwards."""

from collections.abc import Callable

import torch
from torch import Tensor, baddbmm, bmm

from apf.models.layers import EnsembleLinear

relu_backward = torch.ops.aten.threshold_backward.grad_input

ReadoutBackward = Callable[[Tensor], tuple[Tensor, list[Tensor]]]
"""From the gradient of logits [E, N, P] to those of what was read, and of the weights in their order."""


def readout_vjp(
    readout: EnsembleLinear, logit: EnsembleLinear
) -> Callable[[Tensor, int], tuple[Tensor, ReadoutBackward]]:
    """Of x [E, P x N, H], in which N plans are side by side, the logits [E, N, P], and the way back.

    The weights stay where they are.
    """
    weight, bias, of_logit, logit_bias = (p.detach() for layer in (readout, logit) for p in layer.parameters())

    def vjp(x: Tensor, plans: int) -> tuple[Tensor, ReadoutBackward]:
        read = baddbmm(bias, x, weight).relu_()
        logits = baddbmm(logit_bias, read, of_logit)

        def backward(gradient: Tensor) -> tuple[Tensor, list[Tensor]]:
            g = gradient.transpose(1, 2).reshape(logits.shape)
            last = [bmm(read.mT, g), g.sum(1, keepdim=True)]
            g = g * of_logit.mT
            relu_backward(g, read, 0, grad_input=g)
            return bmm(g, weight.mT), [bmm(x.mT, g), g.sum(1, keepdim=True), *last]

        return logits.view(len(logits), -1, plans).transpose(1, 2), backward

    return vjp
