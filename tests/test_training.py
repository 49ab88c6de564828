"""Training an ensemble: examples, early stopping, determinism, learning at all."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from apf.data import Kind, Labelled, examples
from apf.models import Ensemble, EnsembleNetwork, EnsembleSettings, LSTMNetwork, TowersGraphNetwork, Training
from apf.models import training as training_module
from apf.models.training import _batches, fit, validation_loss
from apf.towers import TowerDomain, standing_prefixes
from apf.worlds import AnalyticWorld

DOMAIN = TowerDomain()


def labelled(length: int, n: int, seed: int) -> Labelled:
    plans = DOMAIN.random_plans(length, n, np.random.default_rng(seed))
    return Labelled(plans, AnalyticWorld().execute(plans, np.random.default_rng(0)))


def ensemble(kind: Kind = Kind.SUBSEQUENCE, members: int = 3, **training: float) -> Ensemble:
    settings = EnsembleSettings(members=members, network=partial(TowersGraphNetwork, hidden=16))
    return Ensemble(settings, kind, DOMAIN, Training(**({"max_epochs": 4} | training)), torch.device("cpu"))


def test_a_subsequence_model_learns_from_every_attempted_prefix() -> None:
    plans = DOMAIN.random_plans(4, 3, np.random.default_rng(0))
    labels = np.array([[1, 1, 0, -1], [1, 0, -1, -1], [1, 1, 1, 1]], np.int8)
    by_length = {e.x.shape[1]: e for e in examples([Labelled(plans, labels)], Kind.SUBSEQUENCE, DOMAIN)}
    assert {length: len(e) for length, e in by_length.items()} == {2: 4, 3: 4, 4: 4}  # each seen from four sides
    assert by_length[2].y.tolist() == [[0.0]] * 4
    assert by_length[3].y.tolist() == [[1.0, 0.0]] * 4
    assert by_length[4].y.tolist() == [[1.0, 1.0, 1.0]] * 4
    np.testing.assert_array_equal(by_length[2].x[0], DOMAIN.features(plans)[1, :2])


def test_a_complete_model_learns_one_label_of_the_whole_plan() -> None:
    plans = DOMAIN.random_plans(3, 2, np.random.default_rng(0))
    labels = np.array([[1, 0, -1], [1, 1, 1]], np.int8)
    (only,) = examples([Labelled(plans, labels)], Kind.COMPLETE, DOMAIN)
    assert only.x.shape == (8, 3, DOMAIN.n_features)
    assert only.y.tolist() == [[0.0], [1.0]] * 4


def test_augmentation_turns_the_tower_and_keeps_its_labels() -> None:
    group = labelled(3, 50, 1)
    for view in DOMAIN.symmetries(group.plans):
        np.testing.assert_array_equal(standing_prefixes(view), standing_prefixes(group.plans))


def test_batches_hold_every_example_once_and_about_as_many_labels_each() -> None:
    generators = [torch.Generator().manual_seed(seed) for seed in range(2)]
    pairs, triples = (torch.zeros(40, 2, 10), torch.zeros(40, 1)), (torch.zeros(24, 3, 10), torch.zeros(24, 2))
    batches = list(_batches([pairs, triples], 8, generators, torch.Generator()))
    assert [rows.shape for x, _, rows in batches if x is pairs[0]] == [(2, 8)] * 5
    assert [rows.shape for x, _, rows in batches if x is triples[0]] == [(2, 4)] * 6
    assert len({x.shape[1] for x, _, _ in batches[:5]}) == 2  # the lengths come in random order
    for group in (pairs, triples):
        orders = torch.cat([rows for x, _, rows in batches if x is group[0]], 1)
        assert orders.sort(1).values.tolist() == [list(range(len(group[0])))] * 2
        assert orders[0].tolist() != orders[1].tolist()


def test_a_batch_is_never_empty() -> None:
    batches = _batches([(torch.zeros(2, 5, 10), torch.zeros(2, 4))], 1, [torch.Generator()], torch.Generator())
    assert [rows.shape for *_, rows in batches] == [(1, 1)] * 2


def test_the_same_stream_gives_the_same_weights_and_another_gives_others() -> None:
    model, (train, validation) = ensemble(), (labelled(3, 30, 1), labelled(3, 20, 2))
    weights = []
    for seed in (5, 5, 6):
        model.fit([train], [validation], np.random.default_rng(seed))
        weights.append(torch.cat([w.flatten().clone() for w in model.network.state_dict().values()]))
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def test_each_member_keeps_the_weights_of_its_own_best_epoch(monkeypatch: pytest.MonkeyPatch) -> None:
    """The validation loss is made to be lowest after epoch 1 for member 0 and after epoch 3 for member 1."""
    fake = torch.tensor([[4.0, 4.0], [1.0, 3.0], [2.0, 2.5], [2.0, 1.0], [2.0, 2.0], [2.0, 2.0], [2.0, 2.0]])
    seen: list[list[torch.Tensor]] = []

    def scripted(network: EnsembleNetwork, members: int, groups: object) -> torch.Tensor:
        seen.append([parameter.detach().clone() for parameter in network.parameters()])
        return fake[len(seen) - 1, -members:]

    monkeypatch.setattr(training_module, "validation_loss", scripted)
    model = ensemble(members=2, max_epochs=50, patience=3)
    history = model.fit([labelled(2, 20, 1)], [labelled(2, 8, 2)], np.random.default_rng(0))
    assert history.best_epoch.tolist() == [1, 3]
    assert [len(weights[0]) for weights in seen] == [2, 2, 2, 2, 2, 1, 1]  # member 0 is out of patience after epoch 4
    assert np.isnan(history.train_loss[:, 0]).tolist() == [False] * 5 + [True] * 2
    assert history.best_losses[1] == 1.0
    for number, weight in enumerate(model.network.parameters()):
        assert torch.equal(weight[0], seen[1][number][0])
        assert torch.equal(weight[1], seen[3][number][1])


def test_a_member_trains_the_same_whether_or_not_others_have_stopped() -> None:
    train, validation = [labelled(3, 40, 1)], [labelled(3, 30, 2)]
    histories = []
    for members, patience in (([0, 1, 2], 4), ([0, 1, 2], 40)):
        model = ensemble(members=3, max_epochs=40, patience=patience)
        mine = [torch.Generator().manual_seed(member) for member in members]
        model.network.reset(mine)
        parts = (examples(part, Kind.SUBSEQUENCE, DOMAIN) for part in (train, validation))
        histories.append(fit(model.network, *parts, model.training, mine, torch.Generator()))
    short, long = histories
    member = int(short.best_epoch.argmax())
    stopped = int(np.isfinite(short.validation_loss[:, member]).sum())
    assert np.isnan(short.validation_loss[: stopped - 1]).any()  # another one stopped before
    np.testing.assert_allclose(
        short.validation_loss[:stopped, member], long.validation_loss[:stopped, member], rtol=1e-4
    )


def test_validation_loss_is_the_mean_cross_entropy_of_all_labels() -> None:
    model = ensemble(members=2)
    model.fit([labelled(3, 30, 1)], [labelled(3, 10, 2)], np.random.default_rng(0))
    group = labelled(4, 6, 3)
    (*_, longest) = examples([group], Kind.SUBSEQUENCE, DOMAIN)
    x, y = torch.from_numpy(longest.x), torch.from_numpy(longest.y)
    logits = model.network(x.expand(2, *x.shape)).detach()
    p = torch.sigmoid(logits)
    expected = -(y * p.log() + (1 - y) * (1 - p).log()).mean((1, 2))
    torch.testing.assert_close(validation_loss(model.network, 2, [(x, y)]), expected)


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
    with pytest.raises(FloatingPointError, match="validation loss"):
        model.fit([broken], [group], np.random.default_rng(0))


@pytest.mark.parametrize("network", [partial(TowersGraphNetwork, hidden=32), partial(LSTMNetwork, hidden=16, layers=1)])
def test_it_learns_which_pairs_of_blocks_stand(network: object) -> None:
    settings = EnsembleSettings(members=2, network=network)
    training = Training(max_epochs=25, patience=25)
    model = Ensemble(settings, Kind.SUBSEQUENCE, DOMAIN, training, torch.device("cpu"))
    model.fit([labelled(2, 300, 1)], [labelled(2, 60, 2)], np.random.default_rng(0))
    test = labelled(2, 500, 3)
    right = (model.feasibility(test.plans) > 0.5) == (test.labels[:, 1] == 1)
    assert right.mean() > 0.85
