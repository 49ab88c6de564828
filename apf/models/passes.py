"""How a network is computed and differentiated: as it is defined, by autograd, or by a kernel."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import torch
from torch import Tensor

from apf.models.layers import EnsembleNetwork

Backward = Callable[[Tensor], Sequence[Tensor]]
"""From the gradient of the logits to the gradients of the parameters, in their order."""


class Passes:
    """The forward and the backward pass of a network, from its definition, by autograd. Kernels are sub-classes.

    Predictions take two steps: `prepare` computes what depends on no weights, `logits` the rest. So do updates, in
    which each member has plans of its own: `batcher` and `vjp`. A kernel overrides the methods of either or of both.
    """

    replayable = False
    """Do `batcher` and `vjp` perform the same operations for inputs of the same shapes, whatever the values, and
    without waiting for the device? A GPU then replays a whole update as one CUDA graph (`Replayed`)."""

    parts: tuple[str, ...] = ()
    """Of a kernel: package and name of each class that the network must be made of, in the order of its modules."""

    def __init__(self, network: EnsembleNetwork) -> None:
        self.network = network
        self.parameters = list(network.parameters())

    def prepare(self, x: Tensor, last_only: bool = False) -> Any:
        """Prepare plans for `logits`.

        Args:
            x: [E, N, K, F] features of each member's own plans, or [1, N, K, F] for all members.
            last_only: as in `EnsembleNetwork.forward`.
        """
        return x, last_only

    def batcher(self, x: Tensor, last_only: bool = False) -> Callable[[Tensor], Any]:
        """Prepare training examples once, to gather batches of them.

        Args:
            x: [M, K, F] features of the examples.
            last_only: as in `EnsembleNetwork.forward`.

        Returns:
            A function that takes the rows [E, B] of each member's batch, and prepares these examples for `vjp`.
        """
        return lambda rows: (x[rows], last_only)

    def logits(self, prepared: Any) -> Tensor:
        """Logits of prepared plans: [E, N, K - 1], or [E, N, 1] if `last_only`."""
        x, last_only = prepared
        return self.network(x.expand(len(self.parameters[0]), -1, -1, -1), last_only)

    def vjp(self, prepared: Any) -> tuple[Tensor, Backward]:
        """The vector-Jacobian product: logits of prepared examples, and the function that goes back from them."""
        with torch.enable_grad():
            logits = self.network(*prepared)
        return logits.detach(), partial(torch.autograd.grad, logits, self.parameters, materialize_grads=True)
