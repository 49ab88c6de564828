"""Training an ensemble: examples, batches, what is kept, determinism, learning at all."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf
from pydantic import ValidationError
from torch import nn

from apf.config.values import config_dir
from apf.domain import Kind, Labelled
from apf.models import FCGN, TGN, Ensemble, EnsembleNetwork, EnsembleSettings, LSTMNetwork, Training
from apf.models import training as training_module
from apf.models import updates as updates_module
from apf.models.batches import batches, batches_of
from apf.models.examples import examples
from apf.models.kernels import passes_of
from apf.models.layers import EnsembleLinear
from apf.models.passes import Passes
from apf.models.training import CHECK, History, fit
from apf.models.updates import Rates, Updates, validation_loss
from apf.planning import MonteCarloPlanner
from apf.towers import AnalyticWorld, Tallest, TowerDomain, Towers, random_towers, standing_prefixes
from apf.towers.features import LENGTH, MEAN_SIDE, SIDES, features, mirrored, stretched, weighed

DOMAIN = TowerDomain(mass_scales=0, stretch=False)


def labelled(length: int, n: int, seed: int) -> Labelled:
    plans = DOMAIN.random_plans(length, n, np.random.default_rng(seed))
    return Labelled(plans, AnalyticWorld().execute(plans, np.random.default_rng(0)))


def ensemble(kind: Kind = Kind.SUBSEQUENCE, members: int = 3, odds: float = 1.0, **training: float | None) -> Ensemble:
    settings = EnsembleSettings(members=members, network=partial(TGN, hidden=16))
    return Ensemble(settings, kind, DOMAIN, Training(**({"updates": 20} | training)), torch.device("cpu"), odds)


def test_a_subsequence_model_learns_from_every_attempted_prefix() -> None:
    plans = DOMAIN.random_plans(4, 3, np.random.default_rng(0))
    labels = np.array([[1, 1, 0, -1], [1, 0, -1, -1], [1, 1, 1, 1]], np.int8)
    by_length = {e.x.shape[1]: e for e in examples([Labelled(plans, labels)], Kind.SUBSEQUENCE, DOMAIN)}
    assert {length: len(e) for length, e in by_length.items()} == {
        2: 8,
        3: 8,
        4: 8,
    }  # each seen from four sides, and mirrored
    assert by_length[2].y.tolist() == [[0.0]] * 8
    assert by_length[3].y.tolist() == [[1.0, 0.0]] * 8
    assert by_length[4].y.tolist() == [[1.0, 1.0, 1.0]] * 8
    np.testing.assert_array_equal(by_length[2].x[0], DOMAIN.features(plans)[1, :2])


def test_a_complete_model_learns_one_label_of_the_whole_plan() -> None:
    plans = DOMAIN.random_plans(3, 2, np.random.default_rng(0))
    labels = np.array([[1, 0, -1], [1, 1, 1]], np.int8)
    (only,) = examples([Labelled(plans, labels)], Kind.COMPLETE, DOMAIN)
    assert only.x.shape == (16, 3, DOMAIN.n_features)
    assert only.y.tolist() == [[0.0], [1.0]] * 8


@pytest.mark.parametrize("quarters", range(4))
def test_a_turned_tower_keeps_its_labels(quarters: int) -> None:
    plans = labelled(3, 50, 1).plans
    np.testing.assert_array_equal(standing_prefixes(plans.turned(quarters)), standing_prefixes(plans))


def test_a_tower_of_heavier_blocks_keeps_its_labels() -> None:
    plans = labelled(4, 50, 1).plans
    heavier = Towers(replace(plans.blocks, mass=1.7 * plans.blocks.mass), plans.block, plans.rotation, plans.xy)
    np.testing.assert_array_equal(standing_prefixes(heavier), standing_prefixes(plans))
    np.testing.assert_allclose(features(heavier), weighed(features(plans), heavier.mass), atol=1e-6)


def test_a_mirrored_tower_keeps_its_labels() -> None:
    """The mirror image of a tower: that of its blocks, which are no blocks of the set, at mirrored positions."""
    blocks, mirror = DOMAIN.training_blocks, np.array([-1.0, 1.0, 1.0])
    plans = random_towers(blocks, 3, 50, np.random.default_rng(1))
    upright = Towers(blocks, plans.block, np.zeros_like(plans.rotation), plans.xy)
    image = Towers(replace(blocks, com=blocks.com * mirror), upright.block, upright.rotation, upright.xy * mirror[:2])
    np.testing.assert_array_equal(standing_prefixes(image), standing_prefixes(upright))
    np.testing.assert_allclose(features(image), mirrored(features(upright)), atol=1e-6)


@given(
    factor=st.tuples(*[st.floats(0.3, 3)] * 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_stretched_tower_keeps_its_labels(factor: tuple[float, ...], seed: int) -> None:
    """Its blocks, which are no blocks of the set, are as much longer along each axis as the distances between them."""
    blocks, stretch = DOMAIN.training_blocks, np.array(factor)
    plans = random_towers(blocks, 4, 20, np.random.default_rng(seed))
    upright = Towers(blocks, plans.block, np.zeros_like(plans.rotation), plans.xy)
    longer = replace(blocks, dims=blocks.dims * stretch, com=blocks.com * stretch)
    towers = Towers(longer, upright.block, upright.rotation, upright.xy * stretch[:2])
    np.testing.assert_array_equal(standing_prefixes(towers), standing_prefixes(upright))
    np.testing.assert_allclose(features(towers), stretched(features(upright), np.tile(stretch, (20, 1))), atol=1e-4)


def test_the_views_of_a_tower_are_different_and_their_sides_in_the_range_of_the_set() -> None:
    domain = TowerDomain()
    plans = labelled(4, 30, 1).plans
    views = np.stack(list(domain.views(plans)))
    assert views.shape == (32, 30, 4, domain.n_features)
    assert len(np.unique(views[:, 0].round(4), axis=0)) == 32
    sides, dims = (views[..., SIDES] + MEAN_SIDE) * LENGTH, domain.training_blocks.dims
    assert sides.min() == pytest.approx(dims.min(), rel=0.05)
    assert sides.max() == pytest.approx(dims.max(), rel=0.05)
    assert sides.min() > dims.min() - 1e-6
    assert sides.max() < dims.max() + 1e-6


def test_without_symmetries_a_tower_is_its_own_first_view() -> None:
    domain, plans = TowerDomain(mass_scales=0, stretch=False, mirror=False), labelled(4, 30, 1).plans
    views = list(domain.views(plans))
    assert len(views) == 4
    np.testing.assert_array_equal(views[0], features(plans))


def test_batches_hold_every_example_once_and_about_as_many_labels_each() -> None:
    generators = [torch.Generator().manual_seed(seed) for seed in range(2)]
    sizes = [(40, 1), (24, 2)]  # pairs, and triples with two labels each
    epoch = sum(batches_of(*size, 8) for size in sizes)
    drawn = list(islice(batches(sizes, 8, generators, torch.Generator(), torch.device("cpu")), epoch))
    assert [rows.shape for group, rows in drawn if group == 0] == [(2, 8)] * 5
    assert [rows.shape for group, rows in drawn if group == 1] == [(2, 4)] * 6
    assert len({group for group, _ in drawn[:5]}) == 2  # the lengths come in random order
    for number, (n, _) in enumerate(sizes):
        orders = torch.cat([rows for group, rows in drawn if group == number], 1)
        assert orders.sort(1).values.tolist() == [list(range(n))] * 2
        assert orders[0].tolist() != orders[1].tolist()


def test_a_batch_is_never_empty() -> None:
    drawn = batches([(2, 4)], 1, [torch.Generator()], torch.Generator(), torch.device("cpu"))
    assert [rows.shape for _, rows in islice(drawn, 5)] == [(1, 1)] * 5


def test_an_update_learns_each_example_with_its_own_labels() -> None:
    """One update by hand, with autograd and PyTorch's own optimiser, on rows that differ between members."""
    model = ensemble(members=2)
    *_, group = examples([labelled(3, 40, 1)], Kind.SUBSEQUENCE, DOMAIN)
    model.network.reset([torch.Generator().manual_seed(seed) for seed in range(2)])
    x, y = torch.from_numpy(group.x), torch.from_numpy(group.y)
    plain = copy.deepcopy(model.network)
    rows = torch.tensor([[0, 5, 9, 17], [3, 4, 11, 2]])
    logits, labels = Updates(model.passes, [(x, y)], weight_decay=0.1).step(0, rows, (1e-3, 0.5))
    assert torch.equal(labels, y[rows])
    expected = plain(x[rows])
    torch.testing.assert_close(logits, expected)
    adam = torch.optim.AdamW(plain.parameters(), lr=1e-3, weight_decay=0.1)
    torch.nn.functional.binary_cross_entropy_with_logits(expected, y[rows]).mul(2).backward()
    adam.step()
    for ours, theirs in zip(model.network.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-5)


def test_the_same_stream_gives_the_same_weights_and_another_gives_others() -> None:
    model, (train, validation) = ensemble(), (labelled(3, 30, 1), labelled(3, 20, 2))
    weights = []
    for seed in (5, 5, 6):
        model.fit([train], [validation], np.random.default_rng(seed))
        weights.append(torch.cat([w.flatten().clone() for w in model.network.state_dict().values()]))
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def test_stopped_early_each_member_keeps_the_weights_of_its_own_best_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """The validation loss is made to be lowest at check 1 for member 0 and at check 2 for member 1."""
    fake = torch.tensor([[4.0, 4.0], [1.0, 3.0], [2.0, 1.0], [2.0, 2.0]])
    seen: list[list[torch.Tensor]] = []

    def scripted(passes: Passes, groups: object) -> torch.Tensor:
        seen.append([parameter.detach().clone() for parameter in passes.parameters])
        return fake[len(seen) - 1]

    monkeypatch.setattr(training_module, "validation_loss", scripted)
    model = ensemble(members=2, updates=3 * CHECK + 10, early_stopping=True)
    history = model.fit([labelled(2, 20, 1)], [labelled(2, 8, 2)], np.random.default_rng(0))
    assert history.kept.tolist() == [1, 2]
    assert history.train_loss.shape == (4, 2)  # the last check comes with the last update
    assert history.kept_losses["validation"] == 1.0
    for number, weight in enumerate(model.network.parameters()):
        for member, check in enumerate([1, 2]):
            assert torch.equal(weight[member], seen[check][number][member])


@pytest.mark.parametrize("deaths", [1, 2])
def test_a_member_that_has_died_is_trained_again_and_the_others_stay_as_they_are(
    monkeypatch: pytest.MonkeyPatch, deaths: int
) -> None:
    """Member 1 starts with units that are 0 for every plan; so may the one that takes its place."""
    train, plans = [labelled(3, 40, 1), labelled(4, 40, 2)], DOMAIN.random_plans(4, 100, np.random.default_rng(0))
    alive = ensemble(updates=300)
    assert alive.fit(train, [], np.random.default_rng(0)).restarts == 0
    reset, killed = EnsembleNetwork.reset, []

    def deadly(network: EnsembleNetwork, generators: list[torch.Generator]) -> None:
        reset(network, generators)
        if len(killed) < deaths:
            killed.append(len(generators))
            *_, hidden, _ = (layer for layer in network.modules() if isinstance(layer, EnsembleLinear))
            hidden.weight.data[min(1, len(generators) - 1)] = 0
            hidden.bias.data[min(1, len(generators) - 1)] = -1

    monkeypatch.setattr(EnsembleNetwork, "reset", deadly)
    model = ensemble(updates=300)
    history = model.fit(train, [], np.random.default_rng(0))
    assert killed == [3, 1][:deaths]
    assert history.restarts == deaths
    assert not len(model.dead(examples(train, Kind.SUBSEQUENCE, DOMAIN)))
    said, expected = model.predict(plans).numpy(), alive.predict(plans).numpy()
    np.testing.assert_array_equal(said[[0, 2]], expected[[0, 2]])
    assert said[1].std(0).min() > 0.05
    assert history.train_loss.shape == (6, 3)
    assert (history.train_loss[-1] < 0.5).all()


def the_weights(optimiser: torch.optim.AdamW) -> torch.Tensor:
    """All weights of all members, which are one parameter."""
    ((parameter,),) = (group["params"] for group in optimiser.param_groups)
    return parameter


def learning_rate(optimiser: torch.optim.AdamW) -> float:
    (group,) = optimiser.param_groups
    return float(group["lr"])


def trained(model: Ensemble, *parts: list[Labelled]) -> History:
    """Fit the ensemble to training and validation plans as they are."""
    generators = [torch.Generator().manual_seed(member) for member in range(model.members)]
    model.network.reset(generators)
    groups = [examples(part, Kind.SUBSEQUENCE, DOMAIN) for part in parts]
    return fit(model.passes, *groups, model.training, generators, torch.Generator(), plans=20)


def test_a_look_at_the_validation_loss_changes_nothing_of_the_training() -> None:
    train, validation = [labelled(2, 20, 1), labelled(4, 20, 2)], [labelled(3, 8, 3)]
    looked, blind = (trained(ensemble(updates=4 * CHECK), train, part) for part in (validation, []))
    assert looked.train_loss.shape == (4, 3)
    np.testing.assert_array_equal(looked.train_loss, blind.train_loss)
    assert np.isfinite(looked.validation_loss).all()
    assert np.isnan(blind.validation_loss).all()


def test_the_validation_loss_is_that_of_the_weights_that_are_kept() -> None:
    model, validation = ensemble(updates=2 * CHECK, averaging=0.9), [labelled(3, 30, 3), labelled(2, 30, 4)]
    history = trained(model, [labelled(3, 30, 1), labelled(2, 30, 2)], validation)
    assert history.kept.tolist() == history.validation_loss.argmin(0).tolist()
    groups = [(torch.from_numpy(e.x), torch.from_numpy(e.y)) for e in examples(validation, Kind.SUBSEQUENCE, DOMAIN)]
    assert len({len(x) for x, _ in groups}) == len(groups) == 2
    said = validation_loss(model.passes, groups)
    np.testing.assert_allclose(said.numpy(), history.validation_loss.min(0), rtol=1e-5)


def test_losses_of_a_check_are_means_over_the_updates_since_the_check_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights are made to stay as they are until the first check, then to double, and to stay so."""
    updates: list[float] = []

    def double_once(optimiser: torch.optim.AdamW) -> None:
        updates.append(learning_rate(optimiser))
        if len(updates) == CHECK:
            the_weights(optimiser).mul_(2)

    monkeypatch.setattr(torch.optim.AdamW, "step", double_once)
    group = labelled(2, 10, 1)
    (whole,) = examples([group], Kind.SUBSEQUENCE, DOMAIN)
    model = ensemble(updates=CHECK + 3, averaging=0, batch=len(whole))  # every batch holds all examples
    seen = [(torch.from_numpy(whole.x), torch.from_numpy(whole.y))]
    model.network.reset([torch.Generator().manual_seed(member) for member in range(3)])
    first = validation_loss(model.passes, seen)
    history = trained(model, [group], [])
    expected = torch.stack([first, validation_loss(model.passes, seen)])
    np.testing.assert_allclose(history.train_loss, expected.numpy(), rtol=1e-4)
    assert len(set(history.train_loss.ravel().round(4).tolist())) == 6


def test_an_update_follows_the_gradient_of_each_members_mean_cross_entropy(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[torch.Tensor]] = []

    def note(self: Updates, gradients: Sequence[torch.Tensor], rates: Rates) -> None:
        seen.append([gradient.clone() for gradient in gradients])

    monkeypatch.setattr(Updates, "move", note)
    group = labelled(3, 10, 1)
    model = ensemble(updates=1, batch=1000)
    for part in examples([group], Kind.SUBSEQUENCE, DOMAIN):
        seen.clear()
        generators = [torch.Generator().manual_seed(member) for member in range(3)]
        model.network.reset(generators)
        fit(model.passes, [part], [], model.training, generators, torch.Generator(), plans=20)
        x, y = torch.from_numpy(part.x), torch.from_numpy(part.y)
        logits = model.network(x.expand(3, *x.shape), y.shape[1] < x.shape[1] - 1)
        loss = nn.functional.binary_cross_entropy_with_logits(logits, y.expand_as(logits), reduction="none")
        expected = torch.autograd.grad(loss.mean((1, 2)).sum(), list(model.network.parameters()))
        for ours, theirs in zip(seen[0], expected, strict=True):
            torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(("weight_decay", "plans"), [(40.0, 20), (10.0, 40), (0.0, 5)])
def test_weight_decay_counts_for_less_the_more_plans_there_are(
    weight_decay: float, plans: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[float] = []
    make = torch.optim.AdamW.__init__

    def noted(self: torch.optim.AdamW, *inputs: Any, **options: Any) -> None:
        made.append(options["weight_decay"])
        make(self, *inputs, **options)

    monkeypatch.setattr(torch.optim.AdamW, "__init__", noted)
    model = ensemble(updates=1, weight_decay=weight_decay)
    model.fit([labelled(2, plans // 5, 1)], [labelled(3, plans - plans // 5, 2)], np.random.default_rng(0))
    assert made == [weight_decay / plans]


@pytest.mark.parametrize("early_stopping", [True, False])
def test_the_first_loss_that_is_not_finite_is_named(early_stopping: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(logits: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        of_members = torch.tensor([0.5, torch.inf, torch.nan])
        return torch.zeros_like(logits) + of_members.view(-1, *[1] * (logits.dim() - 1))

    for module in (training_module, updates_module):
        monkeypatch.setattr(module, "cross_entropy", broken)
    model = ensemble(updates=2 * CHECK, early_stopping=early_stopping)
    with pytest.raises(FloatingPointError, match=f"^a loss is inf after {CHECK} updates$"):
        model.fit([labelled(2, 20, 1)], [labelled(2, 8, 2)], np.random.default_rng(0))


def test_without_a_config_settings_are_those_of_the_default_config() -> None:
    default = OmegaConf.to_container(OmegaConf.load(Path(config_dir()) / "config.yaml").training)
    assert asdict(Training()) == default
    assert Training(**default) == Training()


def test_settings_out_of_range_are_refused() -> None:
    Training(learning_rate=1e-9, warmup=0, weight_decay=0, batch=1, updates=1, averaging=0, patience=1)
    for name, values in {
        "learning_rate": (0, -1),
        "warmup": (-1,),
        "weight_decay": (-0.1,),
        "batch": (0,),
        "updates": (0,),
        "averaging": (-0.1, 1, 1.5),
        "patience": (0,),
    }.items():
        for value in values:
            with pytest.raises(ValidationError, match=name):
                Training(**{name: value})


def test_patience_ends_early_stopping_when_no_member_has_improved_for_so_long() -> None:
    parts = [labelled(2, 20, 1)], [labelled(2, 8, 2)]
    full, short = (
        ensemble(members=2, updates=20 * CHECK, early_stopping=True, patience=patience).fit(
            *parts, np.random.default_rng(0)
        )
        for patience in (None, 2 * CHECK)
    )
    checks = len(short.validation_loss)
    assert checks < len(full.validation_loss) == 20
    np.testing.assert_array_equal(short.validation_loss, full.validation_loss[:checks])
    np.testing.assert_array_equal(short.kept, short.validation_loss.argmin(0))
    assert short.kept.max() == checks - 1 - 2


def test_without_validation_plans_the_last_weights_are_kept_though_losses_rise(monkeypatch: pytest.MonkeyPatch) -> None:
    def grow(optimiser: torch.optim.AdamW) -> None:
        the_weights(optimiser).mul_(1.01)

    monkeypatch.setattr(torch.optim.AdamW, "step", grow)
    history = trained(ensemble(updates=3 * CHECK), [labelled(2, 20, 1)], [])
    assert (history.train_loss[-1] > history.train_loss[0]).any()
    assert history.kept.tolist() == [2, 2, 2]


@pytest.mark.parametrize(("patience", "checks"), [(1, 5), (CHECK, 5), (CHECK + 1, 6), (2 * CHECK, 6), (None, 9)])
def test_patience_counts_from_the_last_lowest_loss_of_any_member(
    patience: int | None, checks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Member 0 is best at the first check, member 1 gets better until the fourth; an equal loss is no better one."""
    fake = iter(torch.tensor([[1.0, 9.0], [2, 8], [2, 7], [1, 6], [1, 6], [2, 7], [2, 7], [2, 7], [2, 7]]))
    monkeypatch.setattr(training_module, "validation_loss", lambda passes, groups: next(fake))
    model = ensemble(members=2, updates=9 * CHECK, early_stopping=True, patience=patience)
    history = model.fit([labelled(2, 20, 1)], [labelled(2, 8, 2)], np.random.default_rng(0))
    assert len(history.validation_loss) == checks
    assert history.kept.tolist() == [0, 3]


def test_without_early_stopping_there_is_no_patience() -> None:
    history = ensemble(updates=4 * CHECK, patience=CHECK).fit([labelled(2, 20, 1)], [], np.random.default_rng(0))
    assert len(history.train_loss) == 4


def test_without_early_stopping_all_plans_are_trained_on_and_the_last_weights_kept() -> None:
    parts = labelled(2, 20, 1), labelled(2, 8, 2)
    weights = []
    for train, validation in ((parts[:1], parts[1:]), (parts, ())):
        model = ensemble(updates=CHECK + 1)
        history = model.fit(train, validation, np.random.default_rng(0))
        weights.append([parameter.detach().clone() for parameter in model.network.parameters()])
    assert history.kept.tolist() == [1, 1, 1]
    assert list(history.kept_losses) == ["train"]
    for one, other in zip(*weights, strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize("kind", [TGN, partial(LSTMNetwork, layers=2)])
def test_many_plans_are_judged_as_each_alone_in_chunks(
    kind: Callable[..., EnsembleNetwork], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("apf.models.ensemble.FEW", 0)
    settings = EnsembleSettings(members=2, network=partial(kind, hidden=8))
    model = Ensemble(settings, Kind.SUBSEQUENCE, DOMAIN, Training(), torch.device("cpu"))
    model.network.reset([torch.Generator().manual_seed(e) for e in range(2)])
    towers = DOMAIN.random_plans(4, 2500, np.random.default_rng(0))
    sizes, prepare = set[int](), model.passes.prepare

    def noted(x: torch.Tensor, last_only: bool) -> object:
        sizes.add(x.shape[1])
        return prepare(x, last_only)

    monkeypatch.setattr(model.passes, "prepare", noted)
    everything = model.predict(towers)
    assert len(sizes) == 2 and max(sizes) == 1024
    for n in (1, 7, 255, 300, 1023, 1024, 1025, 2049):
        np.testing.assert_allclose(model.predict(towers[:n]), everything[:, :n], rtol=1e-4)


def test_of_no_plans_nothing_is_said() -> None:
    model, none = ensemble(), labelled(4, 2, 1).plans[:0]
    assert model.predict(none).shape == (3, 0, 3)
    assert model.last_feasibility(none, slice(0, 2)).shape == (0,)


@pytest.mark.parametrize(("warmup", "rates"), [(4, [0.25, 0.5, 0.75, 1, 1, 1]), (1, [1] * 6), (0, [1] * 6)])
def test_the_learning_rate_rises_to_its_value(warmup: int, rates: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []

    monkeypatch.setattr(torch.optim.AdamW, "step", lambda self: seen.append(learning_rate(self)))
    model = ensemble(learning_rate=0.2, warmup=warmup, updates=6)
    model.fit([labelled(2, 20, 1)], [], np.random.default_rng(0))
    assert seen == pytest.approx([0.2 * rate for rate in rates])


def test_what_is_kept_is_a_running_mean_of_the_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the losses: each update is made to add 1 to every weight."""

    def add_one(optimiser: torch.optim.AdamW) -> None:
        the_weights(optimiser).add_(1)

    monkeypatch.setattr(torch.optim.AdamW, "step", add_one)
    group = examples([labelled(2, 20, 1)], Kind.SUBSEQUENCE, DOMAIN)
    for averaging, updates in ((0.0, 7), (0.5, 3), (0.5, 30)):
        model = ensemble(members=2, averaging=averaging, updates=updates)
        generators = [torch.Generator().manual_seed(member) for member in range(2)]
        model.network.reset(generators)
        starts = [parameter.detach().clone() for parameter in model.network.parameters()]
        fit(model.passes, group, group, model.training, generators, torch.Generator(), plans=20)
        kept = 0.0
        for update in range(1, updates + 1):
            share = min(averaging, update / (update + 9))
            kept = share * kept + (1 - share) * update
        for before, after in zip(starts, model.network.parameters(), strict=True):
            torch.testing.assert_close(after.detach(), before + kept)


@pytest.mark.parametrize("kernels", [True, False])
def test_all_weights_move_as_adamw_moves_each_parameter(kernels: bool) -> None:
    network = TGN(members=2, n_features=10, n_position=3, hidden=8)
    network.reset([torch.Generator().manual_seed(seed) for seed in range(2)])
    plain = copy.deepcopy(network)
    updates = Updates(passes_of(network, kernels), [], weight_decay=0.3)
    reference = torch.optim.AdamW(plain.parameters(), weight_decay=0.3)
    generator = torch.Generator().manual_seed(0)
    for update in range(1, 21):
        for parameter in plain.parameters():
            parameter.grad = torch.randn(parameter.mT.shape, generator=generator).mT  # lies otherwise than the weights
        updates.move([parameter.grad for parameter in plain.parameters()], (0.01 * update, 0.5))
        reference.param_groups[0]["lr"] = 0.01 * update
        reference.step()
        for ours, theirs in zip(network.parameters(), plain.parameters(), strict=True):
            torch.testing.assert_close(ours, theirs)


def test_members_train_the_same_alone_and_together() -> None:
    train, validation = [labelled(3, 40, 1)], [labelled(3, 30, 2)]
    losses = []
    for members in ([0, 1, 2], [1]):
        model = ensemble(members=len(members))
        mine = [torch.Generator().manual_seed(member) for member in members]
        model.network.reset(mine)
        parts = (examples(part, Kind.SUBSEQUENCE, DOMAIN) for part in (train, validation))
        history = fit(model.passes, *parts, model.training, mine, torch.Generator(), plans=40)
        losses.append(history.train_loss[-1, members.index(1)])
    np.testing.assert_allclose(*losses, rtol=1e-4)


@pytest.mark.parametrize(("kind", "options"), [(TGN, {}), (FCGN, {}), (LSTMNetwork, {"layers": 2})])
def test_after_sixty_updates_a_kernel_has_the_weights_of_the_definition(
    kind: type[EnsembleNetwork], options: dict[str, int]
) -> None:
    kept = []
    for kernels in (True, False):
        settings = EnsembleSettings(members=2, network=partial(kind, hidden=16, **options), kernels=kernels)
        model = Ensemble(settings, Kind.SUBSEQUENCE, DOMAIN, Training(updates=60), torch.device("cpu"))
        model.fit([labelled(2, 30, 1), labelled(4, 20, 2)], [], np.random.default_rng(0))
        kept.append(list(model.network.parameters()))
    for ours, theirs in zip(*kept, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-4)


def test_validation_loss_is_the_mean_cross_entropy_of_all_labels() -> None:
    model = ensemble(members=2)
    model.fit([labelled(3, 30, 1)], [labelled(3, 10, 2)], np.random.default_rng(0))
    group = labelled(4, 6, 3)
    (*_, longest) = examples([group], Kind.SUBSEQUENCE, DOMAIN)
    x, y = torch.from_numpy(longest.x), torch.from_numpy(longest.y)
    logits = model.network(x.expand(2, *x.shape)).detach()
    p = torch.sigmoid(logits)
    expected = -(y * p.log() + (1 - y) * (1 - p).log()).mean((1, 2))
    torch.testing.assert_close(validation_loss(model.passes, [(x, y)]), expected)


def test_prediction_and_training_may_alternate() -> None:
    model, group = ensemble(), labelled(2, 20, 1)
    model.predict(DOMAIN.random_plans(6, 3, np.random.default_rng(0)))
    model.fit([group, labelled(6, 4, 2)], [group], np.random.default_rng(0))
    assert model.predict(group.plans).shape == (3, 20, 1)


def test_a_plans_feasibility_is_the_product_of_the_members_means() -> None:
    model, plans = ensemble(), DOMAIN.random_plans(4, 5, np.random.default_rng(3))
    model.fit([labelled(3, 30, 1)], [labelled(3, 10, 2)], np.random.default_rng(0))
    p = model.predict(plans)
    assert p.shape == (3, 5, 3)
    np.testing.assert_allclose(model.feasibility(plans), p.mean(0).prod(1))
    for length in (2, 3, 4):
        last = model.last_feasibility(plans.prefix(length))
        np.testing.assert_allclose(last, p.mean(0)[:, length - 2], rtol=1e-5)


@pytest.mark.parametrize(("kind", "outputs"), [(Kind.SUBSEQUENCE, 3), (Kind.COMPLETE, 1)])
def test_plans_are_judged_with_their_odds_multiplied_and_chosen_without(kind: Kind, outputs: int) -> None:
    plans = DOMAIN.random_plans(4, 50, np.random.default_rng(3))
    plain, raised = ensemble(kind), ensemble(kind, odds=3)
    for model in (plain, raised):
        model.fit([labelled(3, 30, 1)], [], np.random.default_rng(0))
    p = plain.predict(plans)
    np.testing.assert_array_equal(raised.predict(plans), p)
    three_times = 3 * p / (1 - p) / (1 + 3 * p / (1 - p))
    assert three_times.shape == (3, 50, outputs)
    np.testing.assert_allclose(raised.feasibility(plans), three_times.mean(0).prod(1))
    np.testing.assert_allclose(raised.last_feasibility(plans), three_times.mean(0)[:, -1], rtol=1e-5)


def test_a_pessimist_doubts_where_members_differ() -> None:
    """The logit is the members' mean logit less one standard deviation; where they agree, it is theirs."""
    model = ensemble(odds=1.5)
    plans = DOMAIN.random_plans(4, 30, np.random.default_rng(0))
    model.network.reset([torch.Generator().manual_seed(seed) for seed in range(3)])
    p = model.predict(plans).numpy()
    logits = np.log(p / (1 - p)) + np.log(1.5)
    expected = 1 / (1 + np.exp(logits.std(0) - logits.mean(0)))
    pessimist = model.with_pessimism(1.0)
    np.testing.assert_allclose(pessimist.feasibility(plans), expected.prod(1), rtol=1e-6)
    np.testing.assert_allclose(
        pessimist.prefix_feasibility(plans, np.random.default_rng(0))[:, 1:], expected.cumprod(1), rtol=1e-5
    )
    assert (pessimist.with_pessimism(2.0).feasibility(plans) < pessimist.feasibility(plans)).all()
    np.testing.assert_array_equal(pessimist.with_pessimism(None).feasibility(plans), model.feasibility(plans))
    model.network.reset([torch.Generator().manual_seed(0) for _ in range(3)])
    np.testing.assert_allclose(pessimist.feasibility(plans), model.feasibility(plans), rtol=1e-5)


@pytest.mark.parametrize("kind", Kind)
def test_a_planner_that_doubts_asks_all_members_at_once(kind: Kind) -> None:
    """What a pessimist says is no mean over members; the choice is that of exhaustive scoring all the same."""
    model = ensemble(kind=kind)
    plans = DOMAIN.random_plans(4, 300, np.random.default_rng(0))
    model.network.reset([torch.Generator().manual_seed(seed) for seed in range(3)])
    planner = MonteCarloPlanner(candidates=300, pessimism=2.0, first=8, chunk=64)
    judge = planner.judge(model)
    choice = planner.plan(Tallest(), planner.pool(plans, judge, np.random.default_rng(0)))
    expected = model.with_pessimism(2.0).feasibility(plans) * Tallest().value(plans)
    assert choice.index == int(expected.argmax())
    assert choice.expected == pytest.approx(expected.max(), rel=1e-5)


def test_the_same_networks_can_be_taken_with_other_odds() -> None:
    plans, rng = DOMAIN.random_plans(4, 50, np.random.default_rng(3)), np.random.default_rng(0)
    model = ensemble(odds=1.5)
    model.fit([labelled(3, 30, 1)], [], rng)
    raised, before = model.with_odds(3), model.feasibility(plans)
    p = model.predict(plans).numpy()
    three_times = 3 * p / (1 - p) / (1 + 3 * p / (1 - p))
    np.testing.assert_allclose(raised.feasibility(plans), three_times.mean(0).prod(1))
    np.testing.assert_array_equal(model.feasibility(plans), before)
    np.testing.assert_array_equal(raised.with_odds(1.5).feasibility(plans), before)
    model.fit([labelled(3, 30, 2)], [], rng)
    np.testing.assert_array_equal(raised.with_odds(1.5).feasibility(plans), model.feasibility(plans))


def test_a_complete_model_has_one_probability_and_no_prefixes() -> None:
    model, group = ensemble(Kind.COMPLETE), labelled(4, 30, 1)
    model.fit([group], [group], np.random.default_rng(0))
    assert model.predict(group.plans).shape == (3, 30, 1)
    assert not model.by_prefix


def test_weights_survive_a_file(tmp_path: Path) -> None:
    model, plans = ensemble(), DOMAIN.random_plans(4, 5, np.random.default_rng(3))
    model.fit([labelled(3, 30, 1)], [labelled(3, 10, 2)], np.random.default_rng(0))
    before = model.predict(plans)
    model.save(tmp_path / "w.safetensors")
    model.network.reset([torch.Generator().manual_seed(9)] * 3)
    assert not np.array_equal(model.predict(plans), before)
    model.load(tmp_path / "w.safetensors")
    np.testing.assert_array_equal(model.predict(plans), before)


def test_a_loss_that_is_not_finite_is_an_error() -> None:
    model, group = ensemble(), labelled(2, 20, 1)
    broken = Labelled(
        group.plans.__class__(group.plans.blocks, group.plans.block, group.plans.rotation, group.plans.xy * np.nan),
        group.labels,
    )
    with pytest.raises(FloatingPointError, match="a loss is nan"):
        model.fit([broken], [group], np.random.default_rng(0))


@pytest.mark.parametrize("network", [partial(TGN, hidden=32), partial(LSTMNetwork, hidden=16, layers=1)])
def test_it_learns_which_pairs_of_blocks_stand(network: object) -> None:
    settings = EnsembleSettings(members=2, network=network)
    training = Training(updates=600)
    model = Ensemble(settings, Kind.SUBSEQUENCE, DOMAIN, training, torch.device("cpu"))
    model.fit([labelled(2, 300, 1)], [labelled(2, 60, 2)], np.random.default_rng(0))
    test = labelled(2, 500, 3)
    right = (model.feasibility(test.plans) > 0.5) == (test.labels[:, 1] == 1)
    assert right.mean() > 0.85
