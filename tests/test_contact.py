"""`model=tgn_contact`: the contact distances, and the network that is told them."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from apf.domain import Kind, Labelled
from apf.errors import InputError
from apf.models import Ensemble, EnsembleSettings, Training
from apf.models.kernels import passes_of
from apf.models.kernels.graph import GraphKernel
from apf.towers import AnalyticWorld, BlockSet, TowerDomain, Towers, features, random_towers, standing_prefixes
from apf.towers.contact import ContactTGN, contact_distances
from apf.towers.features import LENGTH, mirrored

seeds = st.integers(0, 2**32 - 1)
lengths = st.integers(2, 6)
CPU = torch.device("cpu")


def pairs_of(length: int) -> list[tuple[int, int]]:
    """All pairs (upper, lower)."""
    return [(upper, lower) for upper in range(length) for lower in range(upper)]


def distances(x: np.ndarray, pairs: list[tuple[int, int]] | None = None) -> np.ndarray:
    """Features [N, K, F] -> [A, N, 4] contact distances, of all pairs unless some are given."""
    pairs = pairs_of(x.shape[1]) if pairs is None else pairs
    return contact_distances(torch.from_numpy(x)[None].transpose(1, 2), torch.tensor(pairs).T)[0].numpy()


@pytest.fixture(scope="module")
def three() -> BlockSet:
    """A cube of 10 cm; a block of 10 x 6 x 8 cm, its centre of mass 1 cm along x and -2 cm along y; the cube again."""
    dims, com = [[0.1, 0.1, 0.1], [0.1, 0.06, 0.08], [0.1, 0.1, 0.1]], [[0, 0, 0], [0.01, -0.02, 0.03], [0, 0, 0]]
    return BlockSet(("a", "b", "c"), np.array(dims), np.array(com, float), np.array([0.2, 0.5, 0.9]))


def test_distances_of_two_blocks_worked_by_hand(three: BlockSet, build: Callable[..., Towers]) -> None:
    """The patch reaches from -2 to 5 cm in x and from -2 to 4 cm in y; the centre of mass lies at 4 and -1 cm."""
    tower = build(three, [(0, 0, 0.0, 0.0), (1, 0, 0.03, 0.01)])
    np.testing.assert_allclose(distances(features(tower))[0, 0], [0.6, 0.1, 0.1, 0.5], atol=1e-6)


def test_distances_of_three_blocks_worked_by_hand(three: BlockSet, build: Callable[..., Towers]) -> None:
    """On the middle block the patch reaches from 4 to 8 and from -2 to 4 cm; the third centre of mass is at 9 and 1."""
    tower = build(three, [(0, 0, 0.0, 0.0), (1, 0, 0.03, 0.01), (2, 0, 0.09, 0.01)])
    expected = {(1, 0): [0.6, 0.1, 0.1, 0.5], (2, 0): [1.1, 0.3, -0.4, 0.3], (2, 1): [0.5, 0.3, -0.1, 0.3]}
    found = distances(features(tower), list(expected))[:, 0]
    np.testing.assert_allclose(found, list(expected.values()), atol=1e-6)


@given(seeds, lengths)
def test_the_rule_follows_from_the_distances(blocks: BlockSet, seed: int, length: int) -> None:
    """A prefix stands if, for each block and those above it, all means of the distances by mass are positive."""
    towers = random_towers(blocks, length, 100, np.random.default_rng(seed))
    of_pair = dict(zip(pairs_of(length), distances(features(towers)), strict=True))
    stands = standing_prefixes(towers)
    margin = np.full(len(towers), np.inf)
    for top in range(1, length):
        for lower in range(top):
            above = range(lower + 1, top + 1)
            joint = sum(towers.mass[:, j, None] * of_pair[j, lower] for j in above)
            margin = np.minimum(margin, (joint / towers.mass[:, lower + 1 : top + 1].sum(1, keepdims=True)).min(1))
        clear = np.abs(margin) > 1e-4  # [10 cm]; features have single precision
        assert clear.mean() > 0.9
        np.testing.assert_array_equal((margin > 0)[clear], stands[clear, top])


@given(seeds, lengths)
def test_distances_of_a_prefix_are_those_of_the_whole_tower(blocks: BlockSet, seed: int, length: int) -> None:
    towers = random_towers(blocks, 6, 10, np.random.default_rng(seed))
    whole = distances(features(towers), pairs_of(length))
    np.testing.assert_array_equal(whole, distances(features(towers.prefix(length))))


@given(seeds)
def test_where_towers_stand_and_in_which_order_they_come_does_not_matter(blocks: BlockSet, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = features(random_towers(blocks, 4, 10, rng))
    order, moved = rng.permutation(10), x.copy()
    moved[..., -3:] += rng.normal(size=(10, 1, 3))
    np.testing.assert_allclose(distances(moved), distances(x), atol=1e-5)
    np.testing.assert_array_equal(distances(x[order]), distances(x)[:, order])


@given(seeds)
def test_mirrored_and_turned_towers_have_the_same_distances_from_other_edges(blocks: BlockSet, seed: int) -> None:
    towers = random_towers(blocks, 4, 10, np.random.default_rng(seed))
    least_x, least_y, greatest_x, greatest_y = np.moveaxis(distances(features(towers)), -1, 0)
    mirror = np.stack([greatest_x, least_y, least_x, greatest_y], -1)
    quarter = np.stack([greatest_y, least_x, least_y, greatest_x], -1)
    np.testing.assert_allclose(distances(mirrored(features(towers))), mirror, atol=1e-5)
    np.testing.assert_allclose(distances(features(towers.turned(1))), quarter, atol=1e-5)


def test_distances_are_of_about_unit_range(blocks: BlockSet) -> None:
    found = distances(features(random_towers(blocks, 5, 1000, np.random.default_rng(0))))
    assert 0.3 < found.std() < 1.5
    assert LENGTH * np.abs(found).max() < 0.5  # [m]


def test_a_message_is_told_the_distances(blocks: BlockSet) -> None:
    """A weight of one on the first distance alone is that distance, hidden layers and readout passing it on."""
    network = ContactTGN(members=1, n_features=10, n_position=3, hidden=1)
    for parameter in network.parameters():
        parameter.data.zero_()
    first, *others = (layer.weight.data for layer in network.modules() if hasattr(layer, "weight"))
    assert first.shape == (1, 2 * 7 + 3 + 4, 1)
    first[0, -4] = 1
    for weight in others:
        weight[0, 0] = 1
    x = features(random_towers(blocks, 2, 50, np.random.default_rng(0)))
    expected = np.maximum(distances(x)[0, :, 0], 0) / 2  # the mean over two placements
    found = network(torch.from_numpy(x)[None]).detach()[0, :, 0]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_the_kernel_of_tgn_serves_it_and_no_sub_class_of_it() -> None:
    class Other(ContactTGN):
        def forward(self, x: torch.Tensor, last_only: bool = False) -> torch.Tensor:
            return 2 * super().forward(x, last_only)

    made = [network(members=1, n_features=10, n_position=3, hidden=4) for network in (ContactTGN, Other)]
    assert [type(passes_of(network)) is GraphKernel for network in made] == [True, False]
    assert type(passes_of(made[0], kernels=False)) is not GraphKernel


@pytest.mark.parametrize("kernels", [True, False])
@pytest.mark.parametrize("kind", list(Kind))
def test_it_learns(domain: TowerDomain, kind: Kind, kernels: bool) -> None:
    """The loss falls, and novel plans of other blocks are told apart."""
    rng = np.random.default_rng(0)
    towers = [domain.random_plans(length, 60, rng) for length in (2, 3)]
    train = [Labelled(plans, AnalyticWorld().execute(plans, rng)) for plans in towers]

    def network(**sizes: int) -> ContactTGN:
        return ContactTGN(**sizes, hidden=16)

    settings = EnsembleSettings(members=3, network=network, kernels=kernels)
    ensemble = Ensemble(settings, kind, domain, Training(updates=200), CPU)
    losses = ensemble.fit(train, [], rng).train_loss.mean(1)
    assert losses[-1] < 0.6 * losses[0]
    plans, feasible = domain.balanced(2, 200, rng)
    assert ((ensemble.feasibility(plans) > 0.5) == feasible).mean() > 0.8


@pytest.mark.parametrize("domain", [{"position_of": "below"}, {"position_of": "world"}, {"length_unit": 0.01}])
def test_it_refuses_features_that_it_cannot_read(domain: dict) -> None:
    ContactTGN.check_features(TowerDomain())
    with pytest.raises(InputError, match=r"^model is ContactTGN, which needs domain.position_of=bottom and "):
        ContactTGN.check_features(TowerDomain(**domain))
