"""Updates of all members' weights by AdamW."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.nn.utils import parameters_to_vector

from apf.models.batches import Group, last_only
from apf.models.passes import Passes

Rates = Sequence[float] | Tensor
"""Of an update: the learning rate, and the share of the new weights in the running mean."""


class Updates:
    """The weights of all members, and their running mean: two vectors that stay where they are in memory.

    All weights are one parameter to the optimiser, which takes as long for each parameter as for 10,000 weights.

    Args:
        passes: of the network; its parameters become views of the vector of weights.
        groups: training examples, one group for each length.
        weight_decay: of AdamW.
    """

    def __init__(self, passes: Passes, groups: Sequence[Group], weight_decay: float) -> None:
        self.passes = passes
        self.weights = parameters_to_vector(passes.parameters).detach()
        self.mean = self.weights.clone()
        passes.network.use(self.weights)
        self.sources = [(passes.batcher(x, last_only(x, y)), y) for x, y in groups]
        self.learning_rate = torch.zeros((), device=self.weights.device)
        self.weights.grad = torch.zeros_like(self.weights)
        on_gpu = self.weights.device.type == "cuda"
        if on_gpu:  # the first update of each shape runs before it is captured
            warnings.filterwarnings("ignore", "This instance was constructed with capturable=True")
        self.optimiser = torch.optim.AdamW(
            [self.weights],
            lr=self.learning_rate,
            weight_decay=weight_decay,
            fused=True,
            capturable=on_gpu,
        )

    def step(self, group: int, rows: Tensor, rates: Rates) -> tuple[Tensor, Tensor]:
        """Move each member's weights against the gradient of its mean cross-entropy.

        Args:
            group: number of a group of examples.
            rows: [E, B] each member's examples in this group.
            rates: learning rate, and share of the new weights in the running mean.

        Returns:
            Logits before the update, and labels, both [E, B, P].
        """
        batch, y = self.sources[group]
        labels = y.index_select(0, rows.view(-1)).view(*rows.shape, -1)
        logits, backward = self.passes.vjp(batch(rows))
        gradients = backward((logits.sigmoid() - labels).mul_(len(rows) / labels.numel()))
        self.move(gradients, rates)
        return logits, labels

    def move(self, gradients: Sequence[Tensor], rates: Rates) -> None:
        """One step of the optimiser and of the running mean; the gradients are those of the network's parameters."""
        learning_rate, share = rates
        with torch.no_grad():
            torch.cat([gradient.reshape(-1) for gradient in gradients], out=self.weights.grad)
            self.learning_rate.fill_(learning_rate)
            self.optimiser.step()
            self.mean.lerp_(self.weights, share)

    @contextmanager
    def with_mean(self) -> Iterator[None]:
        """The running mean in place of the weights, for a while."""
        own = self.weights.clone()
        self.weights.copy_(self.mean)
        yield
        self.weights.copy_(own)


@torch.inference_mode()
def validation_loss(passes: Passes, groups: Sequence[Group]) -> Tensor:
    """[E] mean binary cross-entropy over all labels of the groups."""
    losses = (cross_entropy(passes.logits(passes.prepare(x[None], last_only(x, y))), y) for x, y in groups)
    total = sum(loss.sum((1, 2)) for loss in losses)
    return torch.as_tensor(total) / sum(y.numel() for _, y in groups)


@torch.inference_mode()
def f1_scores(passes: Passes, groups: Sequence[Group]) -> Tensor:
    """[E] F1 = 2 TP / (2 TP + FP + FN) of the labels 1 over all labels of the groups, predicted if p > 1/2.

    It is 0 where there is no label 1 and none is predicted.
    """
    hits, misses = torch.zeros(()), torch.zeros(())
    for x, y in groups:
        says = passes.logits(passes.prepare(x[None], last_only(x, y))) > 0
        hits = hits.to(x.device) + (says & (y == 1)).sum((1, 2))
        misses = misses.to(x.device) + (says != (y == 1)).sum((1, 2))
    return 2 * hits / (2 * hits + misses).clamp(min=1)


def cross_entropy(logits: Tensor, y: Tensor) -> Tensor:
    """Binary cross-entropy of each label, shaped as the logits; labels of all members may lack the first axis."""
    return binary_cross_entropy_with_logits(logits, y.expand_as(logits), reduction="none")
