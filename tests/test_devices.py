"""Everything runs on a GPU: shown on a machine without one, by a device that refuses what a GPU refuses."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from pretend_gpu import CPU, CUDA, PretendGraph, on_gpu, pretend_gpu

from apf.domain import Kind
from apf.models import (
    FCGN,
    TGN,
    Ensemble,
    EnsembleLinear,
    EnsembleNetwork,
    EnsembleSettings,
    LSTMNetwork,
    Training,
    pick_device,
)
from apf.models import training as training_module
from apf.models.replay import Replayed
from apf.planning import MonteCarloPlanner
from apf.towers.contact import ContactTGN
from benchmarks import gpu
from benchmarks.setting import QUICK, Setting
from benchmarks.timing import measure

NETWORKS = {
    "tgn": partial(TGN, hidden=8),
    "tgn_contact": partial(ContactTGN, hidden=8),
    "fcgn": partial(FCGN, hidden=8),
    "lstm": partial(LSTMNetwork, hidden=8, layers=3),
}


@pytest.fixture(scope="module")
def setting() -> Setting:
    return Setting(replace(QUICK, labelled=40))


def new(
    setting: Setting, device: torch.device, model: str = "tgn", kind: Kind = Kind.SUBSEQUENCE, **training: Any
) -> Ensemble:
    """An untrained ensemble of three members there."""
    members = EnsembleSettings(members=3, network=NETWORKS[model])
    return Ensemble(members, kind, setting.default.domain, Training(**{"updates": 60, **training}), device)


def trained(setting: Setting, device: torch.device, *which: Any, **training: Any) -> Ensemble:
    """The same, after sixty updates."""
    ensemble = new(setting, device, *which, **training)
    ensemble.fit(*setting.split, np.random.default_rng(0))
    return ensemble


def weights(ensemble: Ensemble) -> torch.Tensor:
    return torch.cat([w.detach().cpu().flatten() for w in ensemble.network.state_dict().values()])


class TestThePretendGPU:
    """The device itself: what a GPU takes, and what it refuses."""

    def test_tensors_lie_where_they_are_put_and_results_beside_them(self) -> None:
        with pretend_gpu():
            x = torch.zeros(3, device="cuda")
            assert {x.device, (x + 1).device, x[1:].device, x.new_empty(2).device} == {CUDA}
            assert {torch.zeros(3).device, x.cpu().device, x.to("cpu", torch.float64).device} == {CPU}
            assert torch.nn.Linear(3, 2).to(CUDA)(x).device == CUDA
            assert [part.device for part in x.split(1)] == [CUDA] * 3

    @pytest.mark.parametrize(
        "wrong",
        [
            lambda x: x + torch.zeros(3),
            lambda x: x[torch.tensor([1])],
            lambda x: x.index_select(0, torch.tensor([1])),
            lambda x: torch.cat([x, torch.zeros(3)]),
            lambda x: x.numpy(),
            lambda x: x.uniform_(generator=torch.Generator()),
            lambda x: torch.rand(3, device="cuda", generator=torch.Generator()),
            lambda x: x.addcmul_(x, torch.zeros(3)),
        ],
    )
    def test_it_refuses_draws_and_indices_from_elsewhere(self, wrong: Callable[[torch.Tensor], Any]) -> None:
        with pretend_gpu(), pytest.raises((RuntimeError, TypeError), match="cuda"):
            wrong(torch.zeros(3, device="cuda"))

    def test_a_graph_does_nothing_while_it_is_recorded_and_the_same_operations_whenever_it_is_replayed(self) -> None:
        total, x = torch.zeros(2), torch.tensor([1.0, 2.0])
        graph = PretendGraph()
        with pretend_gpu(), torch.cuda.graph(graph):  # type: ignore[arg-type]
            doubled = x * 2
            total.add_(doubled)
        assert total.tolist() == [0, 0]
        for _ in range(2):
            graph.replay()
        x.fill_(5)
        graph.replay()
        assert doubled.tolist() == [10, 10]
        assert total.tolist() == [14, 18]  # 2 + 2 + 10, 4 + 4 + 10


class TestReplayed:
    def test_replays_what_it_knows_by_key_and_shapes(self) -> None:
        done, steps = torch.zeros(()), []

        def step(key: int, x: torch.Tensor) -> tuple[torch.Tensor]:
            steps.append((key, len(x)))
            done.add_(1)
            return (x * key,)

        with pretend_gpu():
            replayed = Replayed(step)
            for number in range(4):
                for key, n in ((2, 3), (2, 4), (7, 3)):
                    (out,) = replayed(key, torch.full((n,), float(number)))
                    assert out.tolist() == [key * number] * n
        assert steps == [(2, 3), (2, 4), (7, 3)] * 2  # once as it is, once to be recorded
        assert done == 12

    def test_what_it_returns_outlives_the_next_call(self) -> None:
        with pretend_gpu():
            replayed = Replayed(lambda key, x: (x + 1,))
            outs = [replayed(0, torch.tensor([float(i)]))[0] for i in range(5)]
        assert [out.item() for out in outs] == [1, 2, 3, 4, 5]

    def test_a_step_that_looks_at_values_cannot_be_recorded(self) -> None:
        with pretend_gpu():
            replayed = Replayed(lambda key, x: (x * x.sum().item(),))
            replayed(0, torch.ones(2))
            with pytest.raises(RuntimeError, match="not permitted when stream is capturing"):
                replayed(0, torch.ones(2))


@pytest.mark.parametrize(
    ("model", "stopped_early"), [("tgn", True), ("tgn", False), ("tgn_contact", False), ("fcgn", True), ("lstm", True)]
)
def test_updates_that_are_replayed_are_the_same_updates(
    setting: Setting, model: str, stopped_early: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Same weights, to the last bit, as without graphs; nearly those of a CPU, whose rates have more digits."""
    graphs: list[PretendGraph] = []
    with pretend_gpu():
        monkeypatch.setattr(torch.cuda, "CUDAGraph", lambda: graphs.append(PretendGraph()) or graphs[-1])
        with_graphs = weights(trained(setting, CUDA, model, early_stopping=stopped_early))
        monkeypatch.setattr(training_module, "Replayed", lambda step: step)
        without = weights(trained(setting, CUDA, model, early_stopping=stopped_early))
    assert sum(graph.replays for graph in graphs) > 30
    assert torch.equal(with_graphs, without)
    torch.testing.assert_close(
        with_graphs, weights(trained(setting, CPU, model, early_stopping=stopped_early)), rtol=0.02, atol=0.02
    )


@pytest.mark.parametrize("model", NETWORKS)
def test_training_waits_for_the_gpu_at_its_checks_alone(setting: Setting, model: str) -> None:
    moves = []
    for updates in (40, 80):
        with pretend_gpu() as gpu:
            trained(setting, CUDA, model, updates=updates)
            moves.append(gpu.moves)
    assert moves[1] - moves[0] <= 2  # forty more updates, and one more check


@pytest.mark.parametrize("model", NETWORKS)
@pytest.mark.parametrize("kind", Kind)
def test_the_same_weights_say_the_same_and_choose_the_same_tower(setting: Setting, model: str, kind: Kind) -> None:
    here = trained(setting, CPU, model, kind)
    planner, tasks, rng = MonteCarloPlanner(candidates=500), setting.default.task, np.random.default_rng(1)
    plans = setting.random_towers("plans", 300)
    candidates = setting.default.domain.problem(4, planner.candidates, rng)
    with pretend_gpu():
        there = new(setting, CUDA, model, kind)
        there.network.load_state_dict(here.network.state_dict())
        assert all(on_gpu(weight) for weight in there.network.parameters())
        p = there.predict(plans)
        assert on_gpu(p)
        chances = there.feasibility(plans), there.last_feasibility(plans, slice(1, 3))
        choices = [
            planner.plan(task, planner.pool(candidates, there, np.random.default_rng())) for task in tasks.values()
        ]
    np.testing.assert_allclose(p.numpy(), here.predict(plans).numpy(), atol=1e-6)
    np.testing.assert_allclose(chances[0], here.feasibility(plans), atol=1e-6)
    np.testing.assert_allclose(chances[1], here.last_feasibility(plans, slice(1, 3)), atol=1e-6)
    for task, choice in zip(tasks.values(), choices, strict=True):
        assert choice.index == planner.plan(task, planner.pool(candidates, here, rng)).index


def test_many_plans_are_asked_about_in_parts_that_fit(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    plans = setting.random_towers("plans", 200)
    with pretend_gpu():
        ensemble = trained(setting, CUDA, updates=1)
        expected = ensemble.predict(plans).cpu()
        monkeypatch.setattr("apf.models.ensemble.ON_GPU", 3 * 10 * 64)
        np.testing.assert_allclose(ensemble.predict(plans).cpu(), expected, atol=1e-6)
        assert ensemble.predict(plans[:0]).shape == (3, 0, 4)


class MeanNetwork(EnsembleNetwork):
    """As somebody else may write one: a layer of the mean over the placements, trained by autograd."""

    def __init__(self, *, members: int, n_features: int, n_position: int) -> None:
        super().__init__()
        self.layer = EnsembleLinear(members, n_features, 1)

    def forward(self, x: torch.Tensor, last_only: bool = False) -> torch.Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or the last of them."""
        e, n, k, f = x.shape
        means = x.cumsum(2)[:, :, 1:] / torch.arange(2, k + 1, device=x.device)[:, None]
        logits = self.layer(means.reshape(e, -1, f)).view(e, n, k - 1)
        return logits[..., -1:] if last_only else logits


def test_somebody_elses_network_learns_on_a_gpu_without_graphs(setting: Setting) -> None:
    def learned(device: torch.device) -> Ensemble:
        model = EnsembleSettings(members=2, network=MeanNetwork)
        ensemble = Ensemble(model, Kind.SUBSEQUENCE, setting.default.domain, Training(updates=60), device)
        ensemble.fit(*setting.split, np.random.default_rng(0))
        return ensemble

    with pretend_gpu():
        there = weights(learned(CUDA))
    torch.testing.assert_close(there, weights(learned(CPU)), rtol=1e-3, atol=1e-3)


class TestAuto:
    def test_is_the_gpu_where_there_is_one_and_else_the_cpu(self) -> None:
        assert pick_device("auto") == CPU
        with pretend_gpu():
            assert pick_device("auto") == CUDA

    def test_a_gpu_that_cannot_compute_is_left_alone(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """Here PyTorch says so itself: it has no operations for GPUs."""
        monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
        assert pick_device("auto") == CPU
        assert capsys.readouterr().err.startswith("the GPU cannot be used, going on without it: ")


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in gpu.OPERATIONS if name != "run"])
def test_the_benchmarks_of_a_gpu_compare_it_with_the_cpu(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu, "UPDATES", 10)
    monkeypatch.setattr(gpu, "UPDATES_ON_CPU", 2)
    sizes = replace(QUICK, labelled=40, updates=20, candidates=100, plan_candidates=300, repetitions=1)
    with pretend_gpu():
        row = measure(gpu.OPERATIONS[name](Setting(sizes, "cuda")), enough=0.01)
    assert row.seconds > 0
    assert row.reference_ratio is not None
