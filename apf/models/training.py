"""Training a whole ensemble at once: every member has its own start and its own order of examples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from apf.models.batches import Group, batches, batches_of, groups
from apf.models.examples import Examples
from apf.models.layers import GAIN
from apf.models.passes import Passes
from apf.models.replay import Replayed, Step
from apf.models.updates import Updates, cross_entropy, f1_scores, validation_loss
from apf.settings import Count, CountOrNone, Many, Number, Whole, settings

CHECK = 50
"""Updates from one check of the losses to the next, unless they are checked after each epoch."""


@settings
class Training:
    """How the members are fitted: binary cross-entropy, AdamW, a running mean of the weights.

    A validation set here is small, and its plans were chosen because they are uncertain. So its loss says little about
    when to stop: members that stop early are underfitted, and have not learned from the validation plans. Members
    therefore train for a fixed number of updates on all labelled plans. Weight decay and the running mean keep them
    from overfitting.
    """

    learning_rate: Annotated[Number, Field(gt=0, le=10)] = 1e-2
    warmup: CountOrNone = 100
    """Updates during which the learning rate rises to its value. Large first steps make some members die: the output of
    their units is 0 for every plan."""
    weight_decay: Annotated[Number, Field(ge=0, le=1000000000.0)] = 40
    """An update subtracts the share learning_rate x weight_decay / labelled plans of each weight. Like a prior, it
    counts for less with more labelled plans."""
    batch: Many = 64
    """Approximate number of labels in a batch of one member. All plans of a batch have one length."""
    updates: Count = 1000
    epochs: Annotated[Whole, Field(ge=1, le=10_000)] | None = None
    """Train for so many passes over the training examples, and check the losses after each; None: for `updates`."""
    averaging: Annotated[Number, Field(ge=0, lt=1)] = 0.99
    """Share of the running mean of the weights that an update keeps; 0: no mean."""
    early_stopping: bool = False
    """Hold out the validation plans, and keep each member's weights of their lowest loss (Section Learning)?"""
    keep: Literal["loss", "f1"] = "loss"
    """Early stopping keeps the weights of the lowest validation loss, or those of the highest F1 of the labels 1."""
    patience: Count | None = None
    """Early stopping ends the training so many updates after the last lowest loss of any member; None: never."""
    gain: Annotated[Number, Field(gt=0, le=100)] = GAIN
    """Weights start so many times as large as in `torch.nn.Linear`."""
    restarts: Annotated[Whole, Field(ge=0, le=100)] = 5
    """How often a member that died is trained again, from another start, at most."""

    def schedule(self, sizes: Sequence[tuple[int, int]]) -> tuple[int, int]:
        """How many updates a training takes, and how many there are from one check of the losses to the next.

        Args:
            sizes: for each group of training examples, their number, and the number of labels that each of them has.
        """
        if self.epochs is None:
            return self.updates, CHECK
        epoch = sum(batches_of(*size, self.batch) for size in sizes)
        return self.epochs * epoch, epoch

    def rates(self, updates: int) -> list[tuple[float, float]]:
        """For each of so many updates the learning rate, and the share of the new weights in the running mean."""
        return [
            (
                self.learning_rate * min(1.0, update / max(1, self.warmup)),
                1 - min(self.averaging, update / (update + 9)),
            )
            for update in range(1, updates + 1)
        ]


@dataclass(frozen=True)
class History:
    """The losses of E members at C checks.

    train_loss: [C, E] mean over the labels since the check before.
    validation_loss: [C, E] mean over all labels of the validation set; NaN without one.
    kept: [E] the check whose weights each member ended with.
    restarts: how often a member was trained again, because it had died.
    """

    train_loss: np.ndarray
    validation_loss: np.ndarray
    kept: np.ndarray
    restarts: int = 0

    def replaced(self, members: np.ndarray, others: "History") -> "History":
        """These losses, with those of some members from another training; NaN after the last check of a training.

        Args:
            members: [M] numbers of the members.
            others: Of these M members.
        """
        checks = max(len(self.train_loss), len(others.train_loss))
        losses: list[np.ndarray] = []
        for ours, theirs in (
            (self.train_loss, others.train_loss),
            (self.validation_loss, others.validation_loss),
        ):
            joined = np.full((checks, len(self.kept)), np.nan, ours.dtype)
            joined[: len(ours)] = ours
            joined[:, members] = np.nan
            joined[: len(theirs), members] = theirs
            losses.append(joined)
        kept = self.kept.copy()
        kept[members] = others.kept
        train, validation = losses
        return History(train, validation, kept, self.restarts + len(members))

    @property
    def kept_losses(self) -> dict[str, float]:
        """Losses of the weights that were kept, means over members: train, and validation if there was a set."""
        losses = {"train": self.train_loss, "validation": self.validation_loss}
        means = {name: float(np.take_along_axis(loss, self.kept[None], 0).mean()) for name, loss in losses.items()}
        return {name: mean for name, mean in means.items() if np.isfinite(mean)}


def fit(
    passes: Passes,
    train: Sequence[Examples],
    validation: Sequence[Examples],
    training: Training,
    generators: Sequence[torch.Generator],
    length_generator: torch.Generator,
    plans: int,
) -> History:
    """Train a network in place, each member on batches of its own.

    Args:
        passes: of the network.
        train: training examples, one group for each length.
        validation: examples that decide which weights are kept; if empty, the last weights are kept.
        training: the settings.
        generators: one per member, for the order of its examples; on the CPU.
        length_generator: for the order of lengths, which all members share; on the CPU.
        plans: how many labelled plans the training examples are views of.

    Returns:
        The losses, and which weights were kept.

    Raises:
        FloatingPointError: a loss is not finite.
    """
    device = passes.parameters[0].device
    train_groups, validation_groups = groups(train, device), groups(validation, device)
    updates = Updates(passes, train_groups, training.weight_decay / plans)
    kept = KeptWeights(updates.mean, len(generators))
    losses = Losses(len(generators), training.keep)
    labels = [(len(y), y.shape[1]) for _, y in train_groups]
    total, every = training.schedule(labels)
    step, rates = _step(updates, training, total)
    drawn = batches(labels, training.batch, generators, length_generator, device)
    for update, (group, rows) in enumerate(islice(drawn, total), 1):
        losses.collect(*step(group, rows, rates[update - 1]))
        if update % every == 0 or update == total:
            decisive = losses.check(update, updates, validation_groups)
            kept.consider(passes.network.split, updates.mean, decisive if validation else None)
            if training.patience and every * kept.checks_since_lowest >= training.patience:
                break
    passes.network.use(kept.weights)
    train_losses, validation_losses = np.stack(losses.checks, 1)
    return History(train_losses, validation_losses, kept.check)


def _step(updates: Updates, training: Training, total: int) -> tuple[Step, Sequence[Any] | Tensor]:
    """What makes an update, and the rates of all updates. A GPU replays updates, with rates that lie on the GPU."""
    device = updates.weights.device
    if device.type == "cuda" and updates.passes.replayable:
        return Replayed(updates.step), torch.tensor(training.rates(total), device=device)
    return updates.step, training.rates(total)


class Losses:
    """The losses of E members: collected from update to update, and noted at each check.

    Args:
        members: E.
        keep: what decides which weights are kept, `loss` or `f1`.
    """

    def __init__(self, members: int, keep: str = "loss") -> None:
        self.members = members
        self.keep = keep
        self.checks: list[np.ndarray] = []
        """[2, E] training and validation loss at each check."""
        self._answers: list[tuple[Tensor, Tensor]] = []

    def collect(self, logits: Tensor, labels: Tensor) -> None:
        """Keep the logits and labels [E, B, P] of an update until the next check: a GPU then need not be waited for."""
        self._answers.append((logits, labels))

    def check(self, update: int, updates: Updates, validation: Sequence[Group]) -> np.ndarray:
        """Note the losses.

        Args:
            update: the number of updates so far.
            updates: the weights, whose running mean is validated.
            validation: the validation set; may be empty.

        Returns:
            [E] what is lowest for the weights to keep: validation loss, or 1 - F1 of the validation set. Without such a
            set, the training loss.

        Raises:
            FloatingPointError: that loss is not finite.
        """
        loss, f1 = np.full((2, self.members), np.nan, np.float32), None
        logits, labels = (torch.cat([x.flatten(1) for x in part], 1) for part in zip(*self._answers, strict=True))
        self._answers.clear()
        loss[0] = cross_entropy(logits, labels).mean(1).numpy(force=True)
        if validation:
            with updates.with_mean():
                loss[1] = validation_loss(updates.passes, validation).numpy(force=True)
                f1 = f1_scores(updates.passes, validation).numpy(force=True) if self.keep == "f1" else None
        decisive = loss[1 if validation else 0]
        if not np.isfinite(decisive).all():
            raise FloatingPointError(f"a loss is {decisive[~np.isfinite(decisive)][0]} after {update} updates")
        self.checks.append(loss)
        return decisive if f1 is None else 1 - f1


class KeptWeights:
    """The weights that each member ends with: the last ones, or those of its best check on the validation set."""

    def __init__(self, weights: Tensor, members: int) -> None:
        self.weights = torch.empty_like(weights)
        self.lowest = np.full(members, np.inf)
        self.check = np.zeros(members, int)
        """[E] the check that these weights are from."""
        self.checks = 0

    @property
    def checks_since_lowest(self) -> int:
        """Checks since the last one whose weights were kept for any member."""
        return self.checks - 1 - int(self.check.max())

    def consider(self, split: Callable[[Tensor], list[Tensor]], weights: Tensor, loss: np.ndarray | None) -> None:
        """Keep the weights of this check for the members whose loss is their lowest.

        Args:
            split: gives the parts of a vector of weights, each with axis E first.
            weights: the vector of all weights.
            loss: [E] what must be lower than at every check before; None: keep the weights of all members.
        """
        better = np.ones(len(self.check), bool) if loss is None else loss < self.lowest
        if loss is not None:
            self.lowest[better] = loss[better]
        self.check[better] = self.checks
        self.checks += 1
        members = torch.from_numpy(np.flatnonzero(better)).to(weights.device)
        for ours, theirs in zip(split(self.weights), split(weights), strict=True):
            ours.index_copy_(0, members, theirs.index_select(0, members))
