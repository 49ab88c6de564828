"""Training a whole ensemble at once: every member its own order of examples and its own early stop."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from pydantic import PositiveFloat, PositiveInt
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from apf.data import Examples
from apf.models.layers import EnsembleNetwork
from apf.settings import settings


@settings
class Training:
    """How the members are fitted (Section Learning): Adam, binary cross-entropy, early stopping."""

    learning_rate: PositiveFloat = 5e-3
    batch: PositiveInt = 32
    """Examples in a batch of one member."""
    max_epochs: PositiveInt = 100
    patience: PositiveInt = 10
    """A member stops after this many epochs without a lower validation loss, and keeps its best weights."""


@dataclass(frozen=True)
class History:
    """What a fit did. train_loss, validation_loss: [epochs][E] mean per label. epochs: [E], where each was best."""

    train_loss: list[list[float]]
    validation_loss: list[list[float]]
    best_epoch: list[int]


Group = tuple[Tensor, Tensor]
"""Features x [M, K, F] and labels y [M, P] of one length."""


def fit(
    network: EnsembleNetwork,
    members: int,
    train: Sequence[Examples],
    validation: Sequence[Examples],
    training: Training,
    generators: list[torch.Generator],
) -> History:
    """Train the network in place; each member ends with its weights of the lowest validation loss.

    generators: one per member, for the order of its batches. Raises FloatingPointError if a loss is not finite.
    """
    device = next(network.parameters()).device
    train_groups, validation_groups = _to_device(train, device), _to_device(validation, device)
    optimiser = torch.optim.Adam(network.parameters(), lr=training.learning_rate, fused=True)
    best = [parameter.detach().clone() for parameter in network.parameters()]
    best_loss = torch.full((members,), torch.inf, device=device)
    best_epoch = torch.zeros(members, dtype=torch.long, device=device)
    history = History([], [], [])
    for epoch in range(training.max_epochs):
        train_loss = _epoch(network, train_groups, training.batch, optimiser, generators)
        loss = validation_loss(network, members, validation_groups)
        if not torch.isfinite(loss).all():
            worst = loss[~torch.isfinite(loss)][0].item()
            raise FloatingPointError(f"a validation loss is {worst} after epoch {epoch}")
        history.train_loss.append(train_loss.tolist())
        history.validation_loss.append(loss.tolist())
        improved = loss < best_loss
        best_loss = torch.where(improved, loss, best_loss)
        best_epoch[improved] = epoch
        for kept, parameter in zip(best, network.parameters(), strict=True):
            kept[improved] = parameter.detach()[improved]
        if (epoch - best_epoch >= training.patience).all():
            break
    for kept, parameter in zip(best, network.parameters(), strict=True):
        parameter.data.copy_(kept)
    history.best_epoch.extend(best_epoch.tolist())
    return history


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
) -> Tensor:
    """One pass over the examples. Returns the mean training loss of each member [E]."""
    total = torch.zeros(len(generators), device=groups[0][0].device)
    for parts in _batches([len(x) for x, _ in groups], batch, generators):
        optimiser.zero_grad()
        losses, labels = [], 0
        for (x, y), rows in zip(groups, parts, strict=True):
            if rows.shape[1]:
                rows = rows.to(x.device)
                losses.append(_loss(network, x[rows], y[rows]))
                labels += rows.shape[1] * y.shape[1]
        loss = torch.stack(losses).sum(0)
        (loss.sum() / labels).backward()  # members share no weights: the sum trains each on its own mean loss
        optimiser.step()
        total += loss.detach()
    return total / sum(y.numel() for _, y in groups)


def _batches(sizes: list[int], batch: int, generators: list[torch.Generator]) -> Iterator[list[Tensor]]:
    """Batches of an epoch, as indices [E, rows] into each group.

    Every batch holds its share of every length, so that all members, each in its own order, have arrays of one shape.
    """
    orders = [torch.stack([torch.randperm(size, generator=g) for g in generators]) for size in sizes]
    n_batches = max(1, round(sum(sizes) / batch))
    return map(list, zip(*(order.tensor_split(n_batches, dim=1) for order in orders), strict=True))


def _loss(network: EnsembleNetwork, x: Tensor, y: Tensor) -> Tensor:
    """[E] summed binary cross-entropy of x [E, B, K, F] against y [E, B, P]."""
    logits = network(x, whole=y.shape[-1] < x.shape[-2] - 1)
    return binary_cross_entropy_with_logits(logits, y, reduction="none").sum((1, 2))


def _to_device(examples: Sequence[Examples], device: torch.device) -> list[Group]:
    return [(torch.from_numpy(e.x).to(device), torch.from_numpy(e.y).to(device)) for e in examples]
