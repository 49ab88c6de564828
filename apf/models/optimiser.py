"""The optimiser of an ensemble: one step for the weights of all members."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.optim.adamw import adamw


class AdamW:
    """AdamW for tensors of weights, in place: PyTorch's function, with its usual betas.

    PyTorch's class of this name would load its compiler at the first step, which takes seconds.
    """

    def __init__(self, weights: Sequence[Tensor], weight_decay: float) -> None:
        self.weights = list(weights)
        self.weight_decay = weight_decay
        self.means, self.mean_squares = ([torch.zeros_like(w) for w in self.weights] for _ in range(2))
        self.steps = [torch.zeros((), device=w.device) for w in self.weights]

    def step(self, gradients: Sequence[Tensor], learning_rate: float) -> None:
        """Move the weights against their gradients."""
        adamw(
            self.weights,
            [gradient.contiguous() for gradient in gradients],  # the fused step takes memory as it lies
            self.means,
            self.mean_squares,
            [],
            self.steps,
            fused=True,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=learning_rate,
            weight_decay=self.weight_decay,
            eps=1e-8,
            maximize=False,
        )
