"""The optimiser of an ensemble: one step for the weights of all members."""

from collections.abc import Sequence

import torch
from torch import Tensor


class AdamW:
    """AdamW for tensors of weights, in place: PyTorch's fused step, with its usual betas.

    PyTorch's class of this name would load its compiler at the first step, which takes seconds, and takes as long to
    look at the tensors at every step as to change them.
    """

    def __init__(self, weights: Sequence[Tensor], weight_decay: float) -> None:
        self.weights = list(weights)
        self.weight_decay = weight_decay
        self.means, self.mean_squares = ([torch.zeros_like(w) for w in self.weights] for _ in range(2))
        self.steps = torch.zeros((), device=self.weights[0].device)

    def step(self, gradients: Sequence[Tensor], learning_rate: float | Tensor) -> None:
        """Move the weights against their gradients. learning_rate: a number, or a scalar on the weights' device."""
        self.steps += 1
        torch._fused_adamw_(
            self.weights,
            [gradient.contiguous() for gradient in gradients],  # it takes memory as it lies
            self.means,
            self.mean_squares,
            [],
            [self.steps] * len(self.weights),
            lr=learning_rate,
            beta1=0.9,
            beta2=0.999,
            weight_decay=self.weight_decay,
            eps=1e-8,
            amsgrad=False,
            maximize=False,
        )
