"""What kernels have in common: the backward pass of a ReLU, and the readout of two layers."""

from collections.abc import Callable, Sequence

from torch import Tensor, baddbmm, bmm

ReadoutBackward = Callable[[Tensor], tuple[Tensor, list[Tensor]]]
"""From the gradient of logits [E, N, R] to the gradients of the inputs, and of the parameters in their order."""


def relu_backward(gradient: Tensor, output: Tensor) -> Tensor:
    """The gradient of a ReLU's input from that of its output, which is changed in place."""
    return gradient.mul_(output.sign())


def readout_vjp(x: Tensor, parameters: Sequence[Tensor], plans: int) -> tuple[Tensor, ReadoutBackward]:
    """The readout, and its way back.

    Args:
        x: [E, R x N, H] features of R prefixes, of N plans each.
        parameters: weight and bias of the first layer, then of the second.
        plans: N.

    Returns:
        Logits [E, N, R], and the function that goes back from them.
    """
    weight, bias, last_weight, last_bias = parameters
    hidden = baddbmm(bias, x, weight).relu_()
    logits = baddbmm(last_bias, hidden, last_weight)

    def backward(gradient: Tensor) -> tuple[Tensor, list[Tensor]]:
        g = gradient.transpose(1, 2).reshape(logits.shape)
        of_last = [bmm(hidden.mT, g), g.sum(1, keepdim=True)]
        g = relu_backward(g * last_weight.mT, hidden)
        return bmm(g, weight.mT), [bmm(x.mT, g), g.sum(1, keepdim=True), *of_last]

    return logits.view(len(logits), -1, plans).transpose(1, 2), backward
