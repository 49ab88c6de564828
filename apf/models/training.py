"""Training a whole ensemble at once: every member its own start and its own order of examples."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.nn.utils import parameters_to_vector

from apf.data import Examples
from apf.models.layers import EnsembleNetwork
from apf.models.optimiser import AdamW
from apf.settings import Count, CountOrNone, Many, Number, settings

CHECK = 50
"""Updates between two looks at the validation loss."""


@settings
class Training:
    """How the members are fitted: binary cross-entropy, AdamW, a running mean of the weights.

    The few plans of a validation set, chosen because they are uncertain, say little about when to stop: members that
    they stop are underfitted, and lack what these plans teach. So members train for a fixed time on all that is
    labelled; weight decay and the running mean keep them from overfitting.
    """

    learning_rate: Annotated[Number, Field(gt=0, le=10)] = 1e-2
    warmup: CountOrNone = 100
    """Updates during which the learning rate rises to that. With large first steps some members die: their units fall
    silent, and they say the same of every plan."""
    weight_decay: Annotated[Number, Field(ge=0, le=1000000000.0)] = 40
    """An update takes learning_rate x weight_decay / labelled plans of each weight: like a prior, it counts for less
    the more there is to learn from."""
    batch: Many = 64
    """Labels in a batch of one member, about: a batch holds plans of one length."""
    updates: Count = 1000
    averaging: Annotated[Number, Field(ge=0, lt=1)] = 0.99
    """Share of the running mean of weights that an update leaves as it was; 0: no mean."""
    early_stopping: bool = False
    """Hold out the validation plans, and keep each member's weights of their lowest loss (Section Learning)?"""
    patience: Count | None = None
    """Updates after the last of these lowest losses, of whichever member, until such a training ends; None: all."""


@dataclass(frozen=True)
class History:
    """What a fit did, at C checks: mean losses per label [C, E], of training since the check before.

    validation_loss: NaN without a validation set. kept: [E], the check whose weights each member ended with.
    """

    train_loss: np.ndarray
    validation_loss: np.ndarray
    kept: np.ndarray

    @property
    def kept_losses(self) -> dict[str, float]:
        """Losses of the weights that were kept, means over members: train, and validation if there was a set."""
        losses = {"train": self.train_loss, "validation": self.validation_loss}
        means = {name: float(np.take_along_axis(loss, self.kept[None], 0).mean()) for name, loss in losses.items()}
        return {name: mean for name, mean in means.items() if np.isfinite(mean)}


Group = tuple[Tensor, Tensor]
"""Features x [M, K, F] and labels y [M, P] of one length."""

Batch = tuple[Any, Tensor]
"""Examples prepared for a network, and their labels y [E, B, P]."""


def fit(
    network: EnsembleNetwork,
    train: Sequence[Examples],
    validation: Sequence[Examples],
    training: Training,
    generators: list[torch.Generator],
    turns: torch.Generator,
    plans: int,
) -> History:
    """Train the network in place, each member on batches of its own.

    plans: how many labelled plans the training examples are views of.
    validation: to choose by which weights to keep; if empty, the last are kept.
    generators: one per member, for the order of its examples. turns: for the order of lengths.
    Raises FloatingPointError if a loss is not finite.
    """
    device = next(network.parameters()).device
    train_groups, validation_groups = (_to_device(part, device) for part in (train, validation))
    members = len(generators)
    weights = parameters_to_vector(network.parameters()).detach()
    network.use(weights)
    decay = training.weight_decay / plans
    optimiser = AdamW(network.split(weights), decay)
    mean, kept_weights = weights.clone(), torch.empty_like(weights)
    lowest, kept = torch.full((members,), torch.inf), torch.zeros(members, dtype=torch.long)
    losses: list[np.ndarray] = []
    answers: list[tuple[Tensor, Tensor]] = []  # logits and labels [E, B, P] since the last check
    drawn_from = [(network.batcher(x, _whole(x, y)), y) for x, y in train_groups]
    batches = _batches(drawn_from, training.batch, generators, turns)
    vjp = network.vjp()
    for update, (prepared, y) in enumerate(islice(batches, training.updates), 1):
        logits, backward = vjp(prepared)
        answers.append((logits, y))
        gradients = backward((logits.sigmoid() - y).mul_(members / y.numel()))  # of each member's mean cross-entropy
        optimiser.step(gradients, training.learning_rate * min(1.0, update / max(1, training.warmup)))
        mean.lerp_(weights, 1 - min(training.averaging, update / (update + 9)))
        if update % CHECK == 0 or update == training.updates:
            loss = torch.full((2, members), torch.nan)
            said, labels = (torch.cat([part.flatten(1) for part in parts], 1) for parts in zip(*answers, strict=True))
            loss[0] = _loss(said, labels).mean(1)
            if validation:
                with _weights(weights, mean):
                    loss[1] = validation_loss(network, validation_groups)
            decisive = loss[1 if validation else 0]
            if not torch.isfinite(decisive).all():
                worst = decisive[~torch.isfinite(decisive)][0].item()
                raise FloatingPointError(f"a loss is {worst} after {update} updates")
            if validation:
                better = decisive < lowest
                lowest[better], kept[better] = decisive[better], len(losses)
                for ours, theirs in zip(network.split(kept_weights), network.split(mean), strict=True):
                    ours[better] = theirs[better]
            else:
                kept.fill_(len(losses))
                kept_weights.copy_(mean)
            losses.append(loss.numpy())
            answers.clear()
            since_lowest = CHECK * (len(losses) - 1 - int(kept.max()))
            if training.patience and since_lowest >= training.patience:
                break
    network.use(kept_weights)
    train_losses, validation_losses = np.stack(losses, 1)
    return History(train_losses, validation_losses, kept.numpy())


@contextmanager
def _weights(weights: Tensor, others: Tensor) -> Iterator[None]:
    """Other weights in place of these, for a while."""
    own = weights.clone()
    weights.copy_(others)
    yield
    weights.copy_(own)


@torch.inference_mode()
def validation_loss(network: EnsembleNetwork, groups: Sequence[Group]) -> Tensor:
    """[E] mean binary cross-entropy over all labels of the groups."""
    losses = (_loss(network.logits_of(network.prepare(x[None], _whole(x, y))), y) for x, y in groups)
    total = sum(loss.sum((1, 2)) for loss in losses)
    return torch.as_tensor(total) / sum(y.numel() for _, y in groups)


def _batches(
    groups: Sequence[tuple[Callable[[Tensor], Any], Tensor]],
    batch: int,
    generators: list[torch.Generator],
    turns: torch.Generator,
) -> Iterator[Batch]:
    """Batches without end, epoch after epoch. groups: what prepares rows of M examples, and their labels y [M, P].

    A batch holds about `batch` labels of plans of one length, which makes few and large products. Which length is next
    is the same for all members, so that they have arrays of one shape; the plans are each member's own.
    """
    while True:
        epoch = []
        for prepare, y in groups:
            order = torch.stack([torch.randperm(len(y), generator=g) for g in generators]).to(y.device)
            n = batches_of(len(y), y.shape[1], batch)
            for part in order.tensor_split(n, dim=1):
                rows = part.contiguous()
                epoch.append((prepare, rows, y.index_select(0, rows.view(-1)).view(*rows.shape, -1)))
        for i in torch.randperm(len(epoch), generator=turns).tolist():
            prepare, rows, labels = epoch[i]
            yield prepare(rows), labels


def batches_of(examples: int, labels: int, batch: int) -> int:
    """Into how many batches of about `batch` labels an epoch divides examples of so many labels each."""
    return max(1, min(examples, round(examples * labels / batch)))


def _loss(logits: Tensor, y: Tensor) -> Tensor:
    """Binary cross-entropy of each label, as logits; y may lack the first axis, if it is the same for all members."""
    return binary_cross_entropy_with_logits(logits, y.expand_as(logits), reduction="none")


def _whole(x: Tensor, y: Tensor) -> bool:
    """Have plans x [M, K, F] a label each, y [M, 1], and not one for every prefix of two and more, [M, K - 1]?"""
    return y.shape[1] < x.shape[1] - 1


def _to_device(examples: Sequence[Examples], device: torch.device) -> list[Group]:
    return [(torch.from_numpy(e.x).to(device), torch.from_numpy(e.y).to(device)) for e in examples]
