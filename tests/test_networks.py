"""The networks: one stack equals its members, one pass equals one network per prefix."""

from functools import partial

import pytest
import torch
from torch import nn

from apf.models import FCGN, TGN, EnsembleLinear, EnsembleNetwork, LSTMNetwork
from apf.models.conv import PlacementConv
from apf.models.graph import prefix_graph
from apf.models.kernels import passes_of
from apf.models.passes import Passes
from apf.towers.contact import ContactTGN

MEMBERS, F, D, H = 3, 10, 3, 8
NETWORKS = {
    "tgn": TGN,
    "tgn_contact": ContactTGN,
    "tgn_relu": partial(TGN, message_relu=True),
    "fcgn": FCGN,
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
        torch.testing.assert_close(network(x[:, :, :length], last_only=True)[..., 0], every_prefix[..., length - 2])


def test_weights_start_larger_than_torchs_own_and_biases_do_not() -> None:
    layer = EnsembleLinear(members=2, n_in=100, n_out=50)
    for member in range(2):
        layer.reset(member, torch.Generator().manual_seed(member))
    for parameter, bound in ((layer.weight, 0.1 * 2**0.5), (layer.bias, 0.1)):  # 1 / sqrt(100) in torch
        assert parameter.abs().max().item() == pytest.approx(bound, rel=0.1)
        assert parameter.abs().max() <= bound


@pytest.mark.parametrize("name", NETWORKS)
def test_initial_weights_depend_on_the_members_own_generator_alone(name: str) -> None:
    three, two = make(name, 3), make(name, 2)
    for a, b in zip(three.parameters(), two.parameters(), strict=True):
        assert torch.equal(a[:2], b)
        assert not torch.equal(a[0], a[1])


@pytest.mark.parametrize("name", ["tgn", "tgn_contact", "fcgn"])
def test_graph_networks_see_positions_as_differences(name: str) -> None:
    network, x = make(name), torch.randn(MEMBERS, 4, 5, F)
    moved = x.clone()
    moved[..., -D:] += torch.tensor([3.0, -2.0, 1.0])
    torch.testing.assert_close(network(moved), network(x))
    moved[..., 2, -D:] += 0.5
    assert not torch.allclose(network(moved), network(x), atol=1e-4)


def plain_graph_network(network: EnsembleNetwork, x: torch.Tensor, both_ways: bool) -> torch.Tensor:
    """Member 0 on one whole plan [K, F], with loops over placements and edges."""
    w = {key: value[0] for key, value in network.state_dict().items()}

    def layer(name: str, inputs: torch.Tensor) -> torch.Tensor:
        return inputs @ w[f"{name}.weight"] + w[f"{name}.bias"][0]

    own, position = x[:, :-D], x[:, -D:]
    states = []
    for i in range(len(x)):
        aggregated = torch.zeros(H)
        for j in range(len(x)):
            if j > i or (both_ways and j != i):
                hidden = torch.cat([own[j], own[i], position[j] - position[i]])
                for number in (0, 2):
                    hidden = torch.relu(layer(f"conv.message_net.{number}", hidden))
                aggregated = aggregated + layer("conv.message_net.4", hidden)
        states.append(torch.relu(layer("conv.update_net.0", torch.cat([aggregated, own[i]]))))
    return layer("readout.2", torch.relu(layer("readout.0", torch.stack(states).mean(0))))[0]


@pytest.mark.parametrize(("name", "both_ways"), [("tgn", False), ("fcgn", True)])
@pytest.mark.parametrize("length", [2, 4, 5])
def test_graph_networks_compute_what_their_description_says(name: str, both_ways: bool, length: int) -> None:
    network, x = make(name), torch.randn(MEMBERS, 1, length, F)
    expected = plain_graph_network(network, x[0, 0], both_ways)
    torch.testing.assert_close(network(x, last_only=True)[0, 0, 0], expected)


@pytest.mark.parametrize("kernels", [False, True])
@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("last_only", [False, True])
def test_all_members_see_the_same_plans_as_each_would_its_own(name: str, last_only: bool, kernels: bool) -> None:
    passes, x = passes_of(make(name), kernels), torch.randn(1, 5, 4, F)
    same = passes.logits(passes.prepare(x, last_only))
    assert torch.equal(same, passes.logits(passes.prepare(x.expand(MEMBERS, -1, -1, -1), last_only)))


class TestKernels:
    """Each equals the definition; `test_training` compares the weights after sixty updates."""

    @pytest.mark.parametrize("name", NETWORKS)
    @pytest.mark.parametrize("last_only", [False, True])
    @pytest.mark.parametrize("length", [2, 3, 5, 7])
    def test_values_and_gradients_are_those_of_the_definition(self, name: str, last_only: bool, length: int) -> None:
        network, x = make(name), torch.randn(12, length, F)
        rows = torch.stack([torch.randperm(12)[:4] for _ in range(MEMBERS)])
        kernel = passes_of(network)
        assert type(kernel) is not Passes
        logits, backward = kernel.vjp(kernel.batcher(x, last_only)(rows))
        expected = network(x[rows], last_only)
        of_logits = torch.randn(expected.shape)
        gradients = torch.autograd.grad(expected, list(network.parameters()), of_logits, materialize_grads=True)
        torch.testing.assert_close(logits, expected)
        torch.testing.assert_close(kernel.logits(kernel.prepare(x[rows], last_only)), expected)
        for gradient, of_parameter in zip(backward(of_logits), gradients, strict=True):
            torch.testing.assert_close(gradient, of_parameter)

    @pytest.mark.parametrize("name", NETWORKS)
    def test_values_follow_the_weights(self, name: str) -> None:
        network, x = make(name), torch.randn(MEMBERS, 5, 3, F)
        kernel = passes_of(network)
        prepared = kernel.prepare(x)
        for seed in range(2):
            network.reset([torch.Generator().manual_seed(seed + member) for member in range(MEMBERS)])
            torch.testing.assert_close(kernel.logits(prepared), network(x))

    def test_the_switch_turns_them_off(self) -> None:
        assert {type(passes_of(make(name), kernels=False)) for name in NETWORKS} == {Passes}

    @pytest.mark.parametrize("name", NETWORKS)
    def test_a_subclass_that_computes_something_else_is_differentiated_as_it_is(self, name: str) -> None:
        network, x = make(name), torch.randn(MEMBERS, 4, 3, F)
        kind = type(network)
        gradients = []
        for factor in (1, 2):
            forward = {"forward": lambda self, *inputs, factor=factor: factor * kind.forward(self, *inputs)}
            network.__class__ = type("Scaled", (kind,), forward)
            passes = passes_of(network)
            logits, backward = passes.vjp((x, False))
            gradients.append([gradient.clone() for gradient in backward(torch.ones_like(logits))])
        for once, twice in zip(*gradients, strict=True):
            torch.testing.assert_close(2 * once, twice)

    @pytest.mark.parametrize("name", ["tgn", "fcgn"])
    def test_a_network_with_other_messages_computes_and_learns_them(self, name: str) -> None:
        class Louder(PlacementConv):
            def message(self, *args: torch.Tensor, **kwargs: torch.Tensor) -> torch.Tensor:
                return 2 * super().message(*args, **kwargs)

        network, x = make(name), torch.randn(MEMBERS, 4, 3, F)
        quiet = network(x)
        network.conv.__class__ = Louder
        passes = passes_of(network)
        logits, backward = passes.vjp(passes.prepare(x))
        torch.testing.assert_close(logits, network(x))
        assert not torch.allclose(logits, quiet)
        expected = torch.autograd.grad(network(x).sum(), list(network.parameters()))
        for ours, theirs in zip(backward(torch.ones_like(logits)), expected, strict=True):
            torch.testing.assert_close(ours, theirs)

    @pytest.mark.parametrize("name", ["tgn", "fcgn", "lstm"])
    def test_another_part_of_a_library_is_no_part_of_a_kernel(self, name: str) -> None:
        network, x = make(name), torch.randn(MEMBERS, 4, 3, F)
        assert type(passes_of(network)) is not Passes
        network.readout[1] = nn.Tanh()
        passes = passes_of(network)
        torch.testing.assert_close(passes.logits(passes.prepare(x)), network(x))
        assert type(passes) is Passes


@pytest.mark.parametrize(("name", "receives"), [("tgn", False), ("fcgn", True)])
def test_in_tgn_no_placement_gets_messages_from_the_first(name: str, receives: bool) -> None:
    network, x = make(name, members=1), torch.randn(1, 3, 1, F)
    changed = x.clone()
    changed[0, 0, 0, :D] += 1
    edge_index = prefix_graph(3, name == "fcgn", True, x.device).edge_index
    before, after = (network.conv(*nodes.split([F - D, D], -1), edge_index)[:, 1:] for nodes in (x, changed))
    assert torch.allclose(before, after) is not receives


def test_the_graph_of_all_prefixes_is_theirs_side_by_side() -> None:
    """Of three placements: nodes 0, 1 are the prefix of two, nodes 2, 3, 4 the whole plan."""
    graph = prefix_graph(3, False, False, torch.device("cpu"))
    assert graph.placement.tolist() == [0, 1, 0, 1, 2]
    assert graph.prefix.tolist() == [0, 0, 1, 1, 1]
    assert sorted(graph.edge_index.T.tolist()) == [[1, 0], [3, 2], [4, 2], [4, 3]]
    both_ways = prefix_graph(3, True, True, torch.device("cpu"))
    assert sorted(both_ways.edge_index.T.tolist()) == [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


def test_lstm_equals_torchs_own_on_the_placements_from_last_to_first() -> None:
    network, x = make("lstm"), torch.randn(MEMBERS, 5, 4, F)
    w = {key: value[1] for key, value in network.state_dict().items()}
    reference = nn.LSTM(F, H, num_layers=3, batch_first=True)
    order = [0, 1, 3, 2]  # torch keeps the gates as input, forget, candidate, output; ours has the candidate last

    def gates(matrix: torch.Tensor) -> torch.Tensor:
        return torch.cat([matrix.reshape(-1, 4, H)[:, i] for i in order], -1)

    with torch.no_grad():
        for layer in range(3):
            read, state = gates(w[f"layers.{layer}.gates.weight"]).tensor_split([-H])
            getattr(reference, f"weight_ih_l{layer}").copy_(read.T)
            getattr(reference, f"weight_hh_l{layer}").copy_(state.T)
            getattr(reference, f"bias_ih_l{layer}").copy_(gates(w[f"layers.{layer}.gates.bias"])[0])
            getattr(reference, f"bias_hh_l{layer}").zero_()
        last = reference(x[1].flip(1))[0][:, -1]
        hidden = torch.relu(last @ w["readout.0.weight"] + w["readout.0.bias"])
        expected = (hidden @ w["readout.2.weight"] + w["readout.2.bias"])[:, 0]
        torch.testing.assert_close(network(x, last_only=True)[1, :, 0], expected)


def test_members_do_not_mix() -> None:
    network, x = make("tgn"), torch.randn(MEMBERS, 4, 5, F)
    network(x)[1].sum().backward()
    for parameter in network.parameters():
        assert parameter.grad is not None
        assert parameter.grad[0].abs().max() == 0
        assert parameter.grad[2].abs().max() == 0


def test_a_relu_follows_each_message() -> None:
    """Of networks with the same weights, messages differ in their negative parts alone."""
    plain, relu = make("tgn"), make("tgn_relu")
    x = torch.randn(MEMBERS, 4, 2 * (F - D) + D, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        torch.testing.assert_close(relu.conv.message_net(x), plain.conv.message_net(x).clamp(min=0))


def test_a_network_without_positions_sees_all_features_of_both_placements() -> None:
    network = TGN(members=MEMBERS, n_features=F, n_position=0, hidden=H)
    network.reset([torch.Generator().manual_seed(member) for member in range(MEMBERS)])
    assert network.conv.message_net[0].weight.shape == (MEMBERS, 2 * F, H)
    assert network.conv.update_net[0].weight.shape == (MEMBERS, H + F, H)
    x = torch.randn(MEMBERS, 5, 4, F)
    passes = passes_of(network)
    assert type(passes) is not Passes
    torch.testing.assert_close(passes.logits(passes.prepare(x)), network(x))
