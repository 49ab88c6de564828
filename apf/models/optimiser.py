"""The optimiser of an ensemble: one step for the weights of all members."""

import torch
from torch import Tensor
from torch.optim.adamw import adamw


class AdamW:
    """AdamW for one tensor of weights, in place: PyTorch's function, with its usual betas.

    PyTorch's class of this name would load its compiler at the first step, which takes seconds.
    """

    def __init__(self, weights: Tensor, weight_decay: float) -> None:
        self.weights = weights
        self.weight_decay = weight_decay
        self.mean, self.mean_square = torch.zeros_like(weights), torch.zeros_like(weights)
        self.steps = torch.zeros((), device=weights.device)

    def step(self, gradient: Tensor, learning_rate: float) -> None:
        """Move the weights against their gradient."""
        adamw(
            [self.weights],
            [gradient],
            [self.mean],
            [self.mean_square],
            [],
            [self.steps],
            fused=True,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=learning_rate,
            weight_decay=self.weight_decay,
            eps=1e-8,
            maximize=False,
        )
