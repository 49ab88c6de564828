"""The learning half of what is timed: an epoch of training, and a whole acquisition. See `operations`."""

import json
import random
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from apf.commands.run import make_experiment, make_model
from apf.domain import Labelled, Scored
from apf.experiment import TRAIN, VALIDATION, Experiment
from apf.models import Ensemble, Training
from apf.models.batches import batches_of
from apf.models.examples import Examples
from apf.models.training import fit
from apf.rng import stream
from apf.rundir.store import Store
from apf.tracking import NoTracker
from benchmarks import reference as plain
from benchmarks import reference_learning as plain_learning
from benchmarks.limits import products_with_weights, replay
from benchmarks.setting import SEED, Setting
from benchmarks.timing import Case, Target, Timed

EPOCHS = 3
"""How many are trained to time one: what is done once a training is not an epoch's."""


def epoch(setting: Setting, model: str, target: Target) -> Case:
    """One epoch of training on all labelled towers."""
    ensemble = setting.ensemble(f"model={model}")
    train = setting.examples()
    one_epoch = epoch_of(ensemble.training, train)
    generators = new_generators(ensemble)
    samples = plain_samples(setting.labelled)
    check_training(ensemble, train, samples)

    def ours(epochs: int) -> None:
        some = changed(ensemble.training, updates=epochs * one_epoch.updates)
        fit(ensemble.passes, train, [], some, *generators, setting.sizes.labelled)

    fraction = setting.sizes.members_reference
    members = plain_members(ensemble)[:fraction]
    optimisers = [torch.optim.Adam(member.parameters(), lr=ensemble.training.learning_rate) for member in members]
    order = random.Random(SEED)

    def reference() -> None:
        for member, optimiser in zip(members, optimisers, strict=True):
            plain_learning.train_epoch(member, optimiser, samples, order)

    n, e, labels = setting.sizes.labelled, ensemble.members, sum(part.y.size for part in train)
    return Case(
        f"one epoch, {e} {model.upper()} members, {n} labelled towers x 4",
        unit="labels",
        amount=labels,
        ours=Timed(lambda: ours(EPOCHS), 1 / EPOCHS),
        reference=[Timed(reference, e / fraction)],
        limit=[Timed(replay(products_with_weights(ensemble.network, lambda: ours(1))))],
        target=target,
        note=f"{sum(map(len, train)):,} views, {labels:,} labels, batches of {ensemble.training.batch} labels; "
        f"reference: batches of {plain_learning.TRAINING_BATCH} labels, {fraction} of {e} members, scaled",
        repetitions=setting.sizes.repetitions,
    )


def check_training(ensemble: Ensemble, train: list[Examples], samples: plain_learning.Samples) -> None:
    """The same samples in all; with the same weights the same logits, and on one batch the same loss and gradients."""
    network, members = ensemble.network, plain_members(ensemble)
    np.testing.assert_equal(sum(len(y) for _, y in samples.values()), sum(part.y.size for part in train))
    batch = [Examples(part.x[::40], part.y[::40]) for part in train]
    labels = sum(part.y.size for part in batch)
    loss = torch.zeros(ensemble.members)
    gradients = {name: torch.zeros_like(weight) for name, weight in network.named_parameters()}
    plain_loss = [torch.zeros(()) for _ in members]
    for part in batch:
        x, y = torch.from_numpy(part.x), torch.from_numpy(part.y)
        rows = torch.arange(len(x)).expand(ensemble.members, -1)
        logits, backward = ensemble.passes.vjp(ensemble.passes.batcher(x)(rows))
        loss = loss + cross_entropy(logits, y.expand_as(logits)).sum((1, 2)) / labels
        for gradient, of_part in zip(gradients.values(), backward((logits.sigmoid() - y) / labels), strict=True):
            gradient += of_part
        for e, member in enumerate(members):
            for prefix in range(y.shape[1]):  # each a sample of its own
                plain_logits = member(x[:, : prefix + 2])
                torch.testing.assert_close(plain_logits, logits[e, :, prefix], rtol=1e-4, atol=1e-5)
                plain_loss[e] = plain_loss[e] + cross_entropy(plain_logits, y[:, prefix]).sum() / labels
    torch.testing.assert_close(torch.stack(plain_loss), loss, rtol=1e-4, atol=1e-5)
    for e, member in enumerate(members):
        plain_loss[e].backward()
        plain_gradients = {name: weight.grad for name, weight in member.named_parameters()}
        for name, gradient in plain_learning.plain_names({n: g[e] for n, g in gradients.items()}).items():
            torch.testing.assert_close(plain_gradients[name], gradient, rtol=1e-3, atol=1e-6)
    standing_still = changed(epoch_of(ensemble.training, batch), learning_rate=1e-12)
    history = fit(ensemble.passes, batch, [], standing_still, *new_generators(ensemble), plans=1)
    np.testing.assert_allclose(history.train_loss[0], loss.detach().numpy(), rtol=1e-4)


def acquisition(setting: Setting) -> Case:
    """Train to convergence, propose, label, record: one turn of the loop, done by the experiment itself."""
    sizes = setting.sizes
    cfg, config = setting.config(f"plans={sizes.labelled + setting.default.acquisition.plans}")
    ensemble = make_model(cfg, config)

    def prepared() -> Experiment:
        store = Store(Path(tempfile.mkdtemp(prefix="benchmark")), config.domain)
        record_labelled(store, *setting.split)
        return make_experiment(config, ensemble, store, NoTracker())

    def ours(experiment: Experiment) -> None:
        experiment.learn(0)
        experiment.choose(1)
        experiment.execute(1)
        experiment.store.close()
        shutil.rmtree(experiment.store.directory)

    ours(prepared())
    train = setting.examples()
    one_epoch, generators = epoch_of(ensemble.training, train), new_generators(ensemble)
    epochs = ensemble.training.updates / one_epoch.updates
    of_epoch = products_with_weights(
        ensemble.network, lambda: fit(ensemble.passes, train, [], one_epoch, *generators, setting.sizes.labelled)
    )
    of_proposal = products_with_weights(
        ensemble.network,
        lambda: config.sampler.propose(ensemble, config.domain, [], config.acquisition.plans, stream(SEED, "propose")),
    )
    e, plain_epochs = ensemble.members, plain_learning.EPOCHS
    return Case(
        f"a whole acquisition at {sizes.labelled} towers",
        unit="acquisitions",
        amount=1,
        ours=Timed(ours, setup=prepared),
        reference=plain_acquisition(setting, plain_members(ensemble)),
        limit=[Timed(replay(of_epoch), epochs), Timed(replay(of_proposal))],
        target=Target(ratio=12),
        note=f"TGN; ours trains {epochs:.0f} epochs; reference: {plain_epochs} epochs x {e} members, of which "
        f"{sizes.epochs_reference} x {sizes.members_reference} are timed, and "
        f"{sizes.candidates_reference} of {sizes.candidates:,} candidates; scaled",
        repetitions=sizes.acquisitions,
    )


def plain_acquisition(setting: Setting, members: Sequence[nn.Module]) -> list[Timed]:
    """The parts of the reference's acquisition, each timed on its share of the work."""
    sizes, domain, config = setting.sizes, setting.default.domain, setting.default.acquisition
    blocks, rng = plain.block_list(domain.training_blocks), stream(SEED, "plain acquisition")
    towers, labels = plain_towers(setting.labelled)
    samples, validation = (plain_samples(part) for part in setting.split)
    some_members, some_epochs = sizes.members_reference, sizes.epochs_reference
    noise = getattr(setting.default.world, "noise", 0.0)

    def train() -> None:
        for member in members[:some_members]:
            plain_learning.train(member, samples, validation, some_epochs, random.Random(SEED))

    def propose() -> None:
        for length in range(2, 6):
            pool = [plain.random_tower(blocks, length, rng) for _ in range(sizes.candidates_reference // 4)]
            plain_learning.expected_bald(members, pool)

    def label_and_record() -> None:
        with tempfile.NamedTemporaryFile("w") as file:
            for tower in towers[: config.plans]:
                outcome = plain.prefix_labels(plain.displaced(tower, noise, rng))
                json.dump({"tower": [asdict(block) for block in tower], "labels": outcome}, file)

    return [
        Timed(lambda: plain_learning.prefix_samples(towers, labels)),
        Timed(train, len(members) / some_members * plain_learning.EPOCHS / some_epochs),
        Timed(propose, sizes.candidates / sizes.candidates_reference),
        Timed(label_and_record),
    ]


def record_labelled(store: Store, train: Sequence[Labelled], validation: Sequence[Labelled]) -> None:
    """Make the labelled towers the run's initial ones."""
    groups = [*train, *validation]
    splits = [TRAIN] * sum(len(g.plans) for g in train) + [VALIDATION] * sum(len(g.plans) for g in validation)
    store.plan(0, [Scored(g.plans[i : i + 1], np.nan) for g in groups for i in range(len(g.plans))], splits)
    for number, outcome in enumerate(outcome for g in groups for outcome in g.labels):
        store.record(number, outcome)


def plain_members(ensemble: Ensemble) -> list[nn.Module]:
    """The ensemble's members as plain modules of the same weights."""
    return plain_learning.plain_members(ensemble.network, ensemble.domain.n_features, ensemble.domain.n_position)


def plain_towers(labelled: Sequence[Labelled]) -> tuple[list[plain.Tower], list[list[int]]]:
    """The labelled towers as objects, and their labels."""
    towers = [tower for group in labelled for tower in plain.tower_list(group.plans)]
    return towers, [outcome.tolist() for group in labelled for outcome in group.labels]


def plain_samples(labelled: Sequence[Labelled]) -> plain_learning.Samples:
    """What the reference learns from."""
    return plain_learning.prefix_samples(*plain_towers(labelled))


def epoch_of(training: Training, train: Sequence[Examples]) -> Training:
    """The same settings, but for one pass over these examples."""
    return changed(training, updates=sum(batches_of(len(part), part.y.shape[1], training.batch) for part in train))


def changed(training: Training, **values: float) -> Training:
    """The same settings but for these."""
    return Training(**(vars(training) | values))


def new_generators(ensemble: Ensemble) -> tuple[list[torch.Generator], torch.Generator]:
    """One per member, and one for what they share."""
    *members, shared = (torch.Generator().manual_seed(e) for e in range(ensemble.members + 1))
    return members, shared


def cross_entropy(logits: Tensor, y: Tensor) -> Tensor:
    """Of each label, any shape."""
    return binary_cross_entropy_with_logits(logits, y, reduction="none")
