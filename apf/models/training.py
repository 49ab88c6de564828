"""Training a whole ensemble at once: every member its own order of examples and its own early stop."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from pydantic import PositiveFloat, PositiveInt
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.nn.utils import parameters_to_vector

from apf.data import Examples
from apf.models.layers import EnsembleNetwork
from apf.settings import settings


@settings
class Training:
    """How the members are fitted (Section Learning): Adam, binary cross-entropy, early stopping."""

    learning_rate: PositiveFloat = 5e-3
    batch: PositiveInt = 64
    """Labels in a batch of one member, about: a batch holds plans of one length."""
    max_epochs: PositiveInt = 100
    patience: PositiveInt = 10
    """A member stops after this many epochs without a lower validation loss, and keeps its best weights."""


@dataclass(frozen=True)
class History:
    """What a fit did: mean losses per label [epochs, E], NaN once a member has stopped; best_epoch [E]."""

    train_loss: np.ndarray
    validation_loss: np.ndarray
    best_epoch: np.ndarray

    @property
    def best_losses(self) -> tuple[float, float]:
        """Training and validation loss of the weights that were kept, means over members."""
        rows = self.best_epoch[None]
        train, validation = (
            np.take_along_axis(loss, rows, 0).mean() for loss in (self.train_loss, self.validation_loss)
        )
        return float(train), float(validation)


Group = tuple[Tensor, Tensor]
"""Features x [M, K, F] and labels y [M, P] of one length."""


def fit(
    network: EnsembleNetwork,
    train: Sequence[Examples],
    validation: Sequence[Examples],
    training: Training,
    generators: list[torch.Generator],
    turns: torch.Generator,
) -> History:
    """Train the network in place; each member ends with its weights of the lowest validation loss.

    generators: one per member, for the order of its examples. turns: for the order of lengths.
    Raises FloatingPointError if a loss is not finite.
    """
    device = next(network.parameters()).device
    train_groups, validation_groups = _to_device(train, device), _to_device(validation, device)
    members = len(generators)
    weights = nn.Parameter(parameters_to_vector(network.parameters()))
    network.use(weights)
    best = weights.detach().clone()
    best_loss, best_epoch = torch.full((members,), torch.inf), torch.zeros(members, dtype=torch.long)
    losses: list[np.ndarray] = []
    active = torch.arange(members)
    optimiser = torch.optim.Adam([weights], lr=training.learning_rate, fused=True)
    for epoch in range(training.max_epochs):
        loss = torch.full((2, members), torch.nan)
        own = [generators[member] for member in active]
        loss[0, active] = _epoch(network, train_groups, training.batch, optimiser, own, turns)
        loss[1, active] = validation_loss(network, len(active), validation_groups).cpu()
        if not torch.isfinite(loss[1, active]).all():
            worst = loss[1, active][~torch.isfinite(loss[1, active])][0].item()
            raise FloatingPointError(f"a validation loss is {worst} after epoch {epoch}")
        losses.append(loss.numpy())
        improved = loss[1, active] < best_loss[active]
        better = active[improved]
        best_loss[better], best_epoch[better] = loss[1, better], epoch
        for kept, parameter in zip(network.split(best), network.parameters(), strict=True):
            kept[better] = parameter.detach()[improved]
        going = epoch - best_epoch[active] < training.patience
        if not going.any():
            break
        if not going.all():  # members that have stopped cost nothing more
            active = active[going]
            optimiser = _keep(going, network, optimiser)
    network.use(nn.Parameter(best))
    train_loss, valid_loss = np.stack(losses, 1)
    return History(train_loss, valid_loss, best_epoch.numpy())


@torch.inference_mode()
def validation_loss(network: EnsembleNetwork, members: int, groups: Sequence[Group]) -> Tensor:
    """[E] mean binary cross-entropy over all labels of the groups."""
    total = sum(_loss(network, x.expand(members, *x.shape), y.expand(members, *y.shape)) for x, y in groups)
    return torch.as_tensor(total) / sum(y.numel() for _, y in groups)


def _epoch(
    network: EnsembleNetwork,
    groups: Sequence[Group],
    batch: int,
    optimiser: torch.optim.Optimizer,
    generators: list[torch.Generator],
    turns: torch.Generator,
) -> Tensor:
    """One pass over the examples. Returns the mean training loss of each member [E]."""
    total = torch.zeros(len(generators), device=groups[0][0].device)
    for x, y, rows in _batches(groups, batch, generators, turns):
        optimiser.zero_grad(set_to_none=False)
        loss = _loss(network, x[rows], y[rows])
        (loss.sum() / (rows.shape[1] * y.shape[1])).backward()  # members share no weights: each learns from its own
        optimiser.step()
        total += loss.detach()
    return total.cpu() / sum(y.numel() for _, y in groups)


def _batches(
    groups: Sequence[Group], batch: int, generators: list[torch.Generator], turns: torch.Generator
) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """The batches of an epoch, in random order: x and y of a group, and which rows [E, B] of it are in the batch.

    A batch holds about `batch` labels of plans of one length, which makes few and large products. Which length is next
    is the same for all members, so that they have arrays of one shape; the rows are each member's own.
    """
    batches = []
    for x, y in groups:
        order = torch.stack([torch.randperm(len(x), generator=g) for g in generators]).to(x.device)
        n = max(1, min(len(x), round(y.numel() / batch)))
        batches += [(x, y, rows) for rows in order.tensor_split(n, dim=1)]
    for i in torch.randperm(len(batches), generator=turns):
        yield batches[i]


def _loss(network: EnsembleNetwork, x: Tensor, y: Tensor) -> Tensor:
    """[E] summed binary cross-entropy of x [E, B, K, F] against y [E, B, P]."""
    logits = network(x, whole=y.shape[-1] < x.shape[-2] - 1)
    return binary_cross_entropy_with_logits(logits, y, reduction="none").sum((1, 2))


def _keep(members: Tensor, network: EnsembleNetwork, optimiser: torch.optim.Adam) -> torch.optim.Adam:
    """Make the network one of fewer members [E] bool, and go on with their part of the optimiser's state."""

    def part(vector: Tensor) -> Tensor:
        return parameters_to_vector(stack[members] for stack in network.split(vector))

    (weights,) = optimiser.param_groups[0]["params"]
    kept = nn.Parameter(part(weights.detach()))
    goes_on = torch.optim.Adam([kept], **optimiser.defaults)
    goes_on.state[kept] = {
        name: part(value) if value.ndim else value for name, value in optimiser.state[weights].items()
    }
    network.use(kept)
    return goes_on


def _to_device(examples: Sequence[Examples], device: torch.device) -> list[Group]:
    return [(torch.from_numpy(e.x).to(device), torch.from_numpy(e.y).to(device)) for e in examples]
