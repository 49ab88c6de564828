"""The networks: one stack equals its members, one pass equals one network per prefix."""

from collections.abc import Sequence
from functools import partial

import pytest
import torch
from torch import nn

from apf.models import EnsembleLinear, EnsembleNetwork, FullyConnectedGraphNetwork, LSTMNetwork, TowersGraphNetwork
from apf.models.graph import PrefixMessages
from apf.models.prefixes import prefix_graph

MEMBERS, F, D, H = 3, 10, 3, 8
NETWORKS = {
    "tgn": TowersGraphNetwork,
    "fcgn": FullyConnectedGraphNetwork,
    "lstm": partial(LSTMNetwork, layers=3),
}


def make(name: str, members: int = MEMBERS) -> EnsembleNetwork:
    network = NETWORKS[name](members=members, n_features=F, n_position=D, hidden=H)
    network.reset([torch.Generator().manual_seed(100 + member) for member in range(members)])
    return network


def member_of(network: EnsembleNetwork, name: str, member: int) -> EnsembleNetwork:
    alone = make(name, members=1)
    alone.load_state_dict({key: value[member : member + 1] for key, value in network.state_dict().items()})
    return alone


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("length", [2, 3, 5, 7])
@pytest.mark.parametrize("learning", [False, True])
def test_a_stack_equals_its_members_one_by_one(name: str, length: int, learning: bool) -> None:
    network, x = make(name), torch.randn(MEMBERS, 6, length, F)
    with torch.set_grad_enabled(learning):
        stacked = network(x)
        assert stacked.shape == (MEMBERS, 6, length - 1)
        for member in range(MEMBERS):
            torch.testing.assert_close(member_of(network, name, member)(x[member : member + 1])[0], stacked[member])


@pytest.mark.parametrize("name", NETWORKS)
def test_each_prefix_is_judged_as_if_it_were_the_whole_plan(name: str) -> None:
    network, x = make(name), torch.randn(MEMBERS, 4, 6, F)
    every_prefix = network(x)
    for length in range(2, 7):
        torch.testing.assert_close(network(x[:, :, :length], whole=True)[..., 0], every_prefix[..., length - 2])


@pytest.mark.parametrize("last_is_one", [False, True])
def test_weights_start_larger_than_torchs_own_and_biases_do_not(last_is_one: bool) -> None:
    layer = EnsembleLinear(members=2, n_in=100 + last_is_one, n_out=50, last_is_one=last_is_one)
    for member in range(2):
        layer.reset(member, torch.Generator().manual_seed(member))
    weight, bias = layer.weight[:, :100], layer.weight[:, 100:] if layer.bias is None else layer.bias
    assert bias.shape == (2, 1, 50)
    for parameter, bound in ((weight, 0.1 * 2**0.5), (bias, 0.1)):  # 1 / sqrt(100) in torch
        assert parameter.abs().max().item() == pytest.approx(bound, rel=0.1)
        assert parameter.abs().max() <= bound


@pytest.mark.parametrize("name", NETWORKS)
def test_initial_weights_depend_on_the_members_own_generator_alone(name: str) -> None:
    three, two = make(name, 3), make(name, 2)
    for a, b in zip(three.parameters(), two.parameters(), strict=True):
        assert torch.equal(a[:2], b)
        assert not torch.equal(a[0], a[1])


@pytest.mark.parametrize("name", ["tgn", "fcgn"])
def test_graph_networks_see_positions_as_differences(name: str) -> None:
    network, x = make(name), torch.randn(MEMBERS, 4, 5, F)
    moved = x.clone()
    moved[..., -D:] += torch.tensor([3.0, -2.0, 1.0])
    torch.testing.assert_close(network(moved), network(x))
    moved[..., 2, -D:] += 0.5
    assert not torch.allclose(network(moved), network(x), atol=1e-4)


def plain_graph_network(network: EnsembleNetwork, x: torch.Tensor, both_ways: bool) -> torch.Tensor:
    """Member 0 on one whole plan [K, F], with loops, concatenated inputs and a message net applied edge by edge."""
    w = {key: value[0] for key, value in network.state_dict().items()}
    own, position, one = x[:, :-D], x[:, -D:], torch.ones(1)
    states = []
    for i in range(len(x)):
        total = torch.zeros(H)
        for j in range(len(x)):
            if j > i or (both_ways and j != i):
                inputs = torch.cat([own[j], own[i], position[j] - position[i]])
                hidden = torch.relu(torch.cat([inputs, one]) @ w["messages.first.weight"])
                hidden = torch.relu(hidden @ w["messages.middle.weight"] + w["messages.middle.bias"][0])
                total = total + torch.cat([hidden, one]) @ w["last.weight"]
        update = torch.cat([w["update_own.weight"], w["update_messages.weight"]])
        states.append(torch.relu(torch.cat([own[i], one, total]) @ update))
    hidden = torch.relu(torch.stack(states).mean(0) @ w["readout.weight"] + w["readout.bias"][0])
    return (hidden @ w["logit.weight"] + w["logit.bias"][0])[0]


@pytest.mark.parametrize(("name", "both_ways"), [("tgn", False), ("fcgn", True)])
@pytest.mark.parametrize("length", [2, 4, 5])
def test_graph_networks_compute_what_their_description_says(name: str, both_ways: bool, length: int) -> None:
    network, x = make(name), torch.randn(MEMBERS, 1, length, F)
    expected = plain_graph_network(network, x[0, 0], both_ways)
    torch.testing.assert_close(network(x, whole=True)[0, 0, 0], expected)


@pytest.mark.parametrize("name", ["tgn", "fcgn", "lstm"])
@pytest.mark.parametrize("whole", [False, True])
def test_all_members_see_the_same_plans_as_each_would_its_own(name: str, whole: bool) -> None:
    network, x = make(name), torch.randn(1, 5, 4, F)
    same = network.logits_of(network.prepare(x, whole))
    assert torch.equal(same, network(x.expand(MEMBERS, -1, -1, -1), whole))


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("length", [2, 3, 5])
def test_each_member_learns_from_its_own_examples_as_autograd_says(name: str, whole: bool, length: int) -> None:
    network, x = make(name), torch.randn(12, length, F)
    rows = torch.stack([torch.randperm(12)[:4] for _ in range(MEMBERS)])
    logits, backward = network.vjp()(network.batcher(x, whole)(rows))
    of_logits = torch.randn(logits.shape)
    expected = network(x[rows], whole)
    gradients = torch.autograd.grad(expected, list(network.parameters()), of_logits, materialize_grads=True)
    torch.testing.assert_close(logits, expected)
    for gradient, of_parameter in zip(backward(of_logits), gradients, strict=True):
        torch.testing.assert_close(gradient, of_parameter)


@pytest.mark.parametrize("name", NETWORKS)
def test_a_subclass_with_other_logits_learns_from_them(name: str) -> None:
    warm, cold, x = make(name, members=1), make(name, members=1), torch.randn(1, 4, 3, F)
    kind = type(cold)
    cold.__class__ = type("Colder", (kind,), {"logits_of": lambda self, x: 2 * kind.logits_of(self, x)})
    for ours, theirs in zip(*(backward_of(network, x) for network in (warm, cold)), strict=True):
        torch.testing.assert_close(2 * ours, theirs)


def test_a_network_with_other_messages_learns_from_them() -> None:
    class Louder(PrefixMessages):
        def message(self, pairs: torch.Tensor) -> torch.Tensor:
            return 2 * super().message(pairs)

    network, x = lone(TowersGraphNetwork), torch.randn(1, 4, 3, F)
    quiet = backward_of(network, x)
    network.messages.__class__ = Louder
    loud = torch.autograd.grad(network(x).sum(), list(network.parameters()), materialize_grads=True)
    for ours, theirs in zip(backward_of(network, x), loud, strict=True):
        torch.testing.assert_close(ours, theirs)
    assert not torch.allclose(loud[0], quiet[0])


def lone(kind: type[TowersGraphNetwork]) -> TowersGraphNetwork:
    """One member, always with the same weights."""
    network = kind(members=1, n_features=F, n_position=D, hidden=H)
    network.reset([torch.Generator().manual_seed(1)])
    return network


def backward_of(network: EnsembleNetwork, x: torch.Tensor) -> Sequence[torch.Tensor]:
    logits, backward = network.vjp()(network.prepare(x))
    return backward(torch.ones_like(logits))


@pytest.mark.parametrize(("name", "heard"), [("tgn", False), ("fcgn", True)])
def test_in_tgn_no_block_hears_from_the_bottom_one(name: str, heard: bool) -> None:
    x = torch.randn(1, 1, 3, F)
    changed = x.clone()
    changed[0, 0, 0, :D] += 1
    graph = prefix_graph(3, name == "fcgn", True, x.device)
    network = make(name, members=1)
    pairs = (network.prepare(v, whole=True).pairs for v in (x, changed))
    hearing = graph.block[: graph.hear.stop - graph.hear.start]
    before, after = (network.messages(p, graph)[:, hearing > 0] for p in pairs)
    assert torch.allclose(before, after) is not heard


def test_lstm_equals_torchs_own_on_the_blocks_from_top_to_bottom() -> None:
    network, x = make("lstm"), torch.randn(MEMBERS, 5, 4, F)
    w = {key: value[1] for key, value in network.state_dict().items()}
    reference = nn.LSTM(F, H, num_layers=3, batch_first=True)
    order = [0, 1, 3, 2]  # torch keeps the gates as input, forget, candidate, output; ours has the candidate last

    def gates(matrix: torch.Tensor) -> torch.Tensor:
        return torch.cat([matrix.reshape(-1, 4, H)[:, i] for i in order], -1)

    with torch.no_grad():
        for layer in range(3):
            read, state = gates(w[f"layers.{layer}.weight"]).tensor_split([-H])
            getattr(reference, f"weight_ih_l{layer}").copy_(read.T)
            getattr(reference, f"weight_hh_l{layer}").copy_(state.T)
            getattr(reference, f"bias_ih_l{layer}").copy_(gates(w[f"layers.{layer}.bias"])[0])
            getattr(reference, f"bias_hh_l{layer}").zero_()
        last = reference(x[1].flip(1))[0][:, -1]
        hidden = torch.relu(last @ w["readout.weight"] + w["readout.bias"])
        expected = (hidden @ w["logit.weight"] + w["logit.bias"])[:, 0]
        torch.testing.assert_close(network(x, whole=True)[1, :, 0], expected)


def test_members_do_not_mix() -> None:
    network, x = make("tgn"), torch.randn(MEMBERS, 4, 5, F)
    network(x)[1].sum().backward()
    for parameter in network.parameters():
        assert parameter.grad is not None
        assert parameter.grad[0].abs().max() == 0
        assert parameter.grad[2].abs().max() == 0
