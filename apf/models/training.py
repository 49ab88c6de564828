"""Training a whole ensemble at once: every member its own start and its own order of examples."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.nn.utils import parameters_to_vector

from apf.models.examples import Examples
from apf.models.layers import EnsembleNetwork
from apf.models.optimiser import AdamW
from apf.models.replay import Replayed, Step
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

    def rates(self) -> list[tuple[float, float]]:
        """For each update the learning rate, and the share of the new weights in the running mean."""
        return [
            (
                self.learning_rate * min(1.0, update / max(1, self.warmup)),
                1 - min(self.averaging, update / (update + 9)),
            )
            for update in range(1, self.updates + 1)
        ]


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

Rates = Sequence[float] | Tensor
"""Of an update: the learning rate, and the share of the new weights in the running mean."""


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
    generators: one per member, for the order of its examples. turns: for the order of lengths. All on the CPU.
    Raises FloatingPointError if a loss is not finite.
    """
    device = next(network.parameters()).device
    train_groups, validation_groups = (_to_device(part, device) for part in (train, validation))
    updates = Updates(network, train_groups, training.weight_decay / plans)
    step: Step = updates.step
    rates: Sequence[Rates] | Tensor = training.rates()
    if device.type == "cuda" and network.replayable:
        step, rates = Replayed(step), torch.tensor(rates, device=device)
    kept = KeptWeights(updates.mean, len(generators))
    losses: list[np.ndarray] = []
    answers: list[tuple[Tensor, ...]] = []  # logits and labels [E, B, P] since the last check
    sizes = [(len(y), y.shape[1]) for _, y in train_groups]
    batches = _batches(sizes, training.batch, generators, turns, device)
    for update, (group, rows) in enumerate(islice(batches, training.updates), 1):
        answers.append(step(group, rows, rates[update - 1]))
        if update % CHECK == 0 or update == training.updates:
            loss = np.full((2, len(generators)), np.nan, np.float32)
            logits, labels = (torch.cat([part.flatten(1) for part in parts], 1) for parts in zip(*answers, strict=True))
            answers.clear()
            loss[0] = _loss(logits, labels).mean(1).numpy(force=True)
            if validation:
                with updates.with_mean():
                    loss[1] = validation_loss(network, validation_groups).numpy(force=True)
            decisive = loss[1 if validation else 0]
            if not np.isfinite(decisive).all():
                worst = decisive[~np.isfinite(decisive)][0]
                raise FloatingPointError(f"a loss is {worst} after {update} updates")
            kept.consider(network.split, updates.mean, decisive if validation else None, len(losses))
            losses.append(loss)
            since_lowest = CHECK * (len(losses) - 1 - int(kept.check.max()))
            if training.patience and since_lowest >= training.patience:
                break
    network.use(kept.weights)
    train_losses, validation_losses = np.stack(losses, 1)
    return History(train_losses, validation_losses, kept.check)


class Updates:
    """The weights of all members as they are trained, and their running mean: two vectors that stay where they are."""

    def __init__(self, network: EnsembleNetwork, groups: Sequence[Group], weight_decay: float) -> None:
        self.weights = parameters_to_vector(network.parameters()).detach()
        self.mean = self.weights.clone()
        network.use(self.weights)
        self.sources = [(network.batcher(x, _whole(x, y)), y) for x, y in groups]
        self.vjp = network.vjp()
        self.optimiser = AdamW(network.split(self.weights), weight_decay)

    def step(self, group: int, rows: Tensor, rates: Rates) -> tuple[Tensor, Tensor]:
        """Move each member's weights by its examples, rows [E, B] of a group: logits and labels [E, B, P]."""
        prepare, y = self.sources[group]
        learning_rate, share = rates
        labels = y.index_select(0, rows.view(-1)).view(*rows.shape, -1)
        logits, backward = self.vjp(prepare(rows))
        # of each member's mean cross-entropy
        gradients = backward((logits.sigmoid() - labels).mul_(len(rows) / labels.numel()))
        self.optimiser.step(gradients, learning_rate)
        self.mean.lerp_(self.weights, share)
        return logits, labels

    @contextmanager
    def with_mean(self) -> Iterator[None]:
        """The running mean in place of the weights, for a while."""
        own = self.weights.clone()
        self.weights.copy_(self.mean)
        yield
        self.weights.copy_(own)


class KeptWeights:
    """The weights that each member ends with: the last ones, or those of its lowest validation loss."""

    def __init__(self, weights: Tensor, members: int) -> None:
        self.weights = torch.empty_like(weights)
        self.lowest = np.full(members, np.inf)
        self.check = np.zeros(members, int)
        """[E] when they were."""

    def consider(
        self, split: Callable[[Tensor], list[Tensor]], weights: Tensor, loss: np.ndarray | None, check: int
    ) -> None:
        """Take the weights of this check for the members [E] whose loss is their lowest; None: for all.

        split: gives the parts of a vector of weights, each with axis E first.
        """
        better = np.ones(len(self.check), bool) if loss is None else loss < self.lowest
        if loss is not None:
            self.lowest[better] = loss[better]
        self.check[better] = check
        members = torch.from_numpy(np.flatnonzero(better)).to(weights.device)
        for ours, theirs in zip(split(self.weights), split(weights), strict=True):
            ours.index_copy_(0, members, theirs.index_select(0, members))


@torch.inference_mode()
def validation_loss(network: EnsembleNetwork, groups: Sequence[Group]) -> Tensor:
    """[E] mean binary cross-entropy over all labels of the groups."""
    losses = (_loss(network.logits_of(network.prepare(x[None], _whole(x, y))), y) for x, y in groups)
    total = sum(loss.sum((1, 2)) for loss in losses)
    return torch.as_tensor(total) / sum(y.numel() for _, y in groups)


def _batches(
    sizes: Sequence[tuple[int, int]],
    batch: int,
    generators: list[torch.Generator],
    turns: torch.Generator,
    device: torch.device,
) -> Iterator[tuple[int, Tensor]]:
    """Batches without end, epoch after epoch: the number of a group, and rows [E, B] of it on the device.

    sizes: of each group, how many examples, and how many labels each of them has.

    A batch holds about `batch` labels of plans of one length, which makes few and large products. Which length is next
    is the same for all members, so that they have arrays of one shape; the plans are each member's own.
    """
    while True:
        epoch = []
        for group, (examples, labels) in enumerate(sizes):
            order = torch.stack([torch.randperm(examples, generator=g) for g in generators]).to(device)
            parts = order.tensor_split(batches_of(examples, labels, batch), dim=1)
            epoch += [(group, part.contiguous()) for part in parts]
        for i in torch.randperm(len(epoch), generator=turns).tolist():
            yield epoch[i]


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
