"""A plain implementation of learning: one network after another, every prefix a sample of its own, exhaustive scores.

The second half of `reference`. A member of the ensemble is an ordinary torch module that sees towers of one length
[B, K, F] and answers one logit for each [B].
"""

import random
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from itertools import permutations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from apf.models import FCGN, EnsembleNetwork, LSTMNetwork
from benchmarks.reference import Tower, features, four_views

TRAINING_BATCH = 16
"""Samples in a batch, as in the published experiments."""
SCORING_BATCH = 64
"""Towers scored at once, as in the published experiments."""
EPOCHS = 20
"""Epochs of one training, as in the published experiments; the weights of the lowest validation loss are kept."""

Samples = dict[int, tuple[Tensor, Tensor]]
"""By length K: features [M, K, F] and labels [M]."""


# -- networks -------------------------------------------------------------------------------------------------------


class GraphMember(nn.Module):
    """One graph network: messages between pairs of blocks, their sum, an update, the mean over blocks, a readout."""

    def __init__(self, n_own: int, n_position: int, hidden: int, both_ways: bool) -> None:
        super().__init__()
        self.n_own, self.n_position, self.both_ways = n_own, n_position, both_ways
        self.message = nn.Sequential(
            nn.Linear(2 * n_own + n_position, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
        )
        self.update = nn.Sequential(nn.Linear(n_own + hidden, hidden), nn.ReLU())
        self.readout = nn.Sequential(nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))

    def forward(self, x: Tensor) -> Tensor:
        """[B, K, F] -> [B]."""
        own, position = x.split([self.n_own, self.n_position], -1)
        pairs = [(i, j) for i, j in permutations(range(x.shape[1]), 2) if self.both_ways or i > j]
        source, target = torch.tensor(pairs).T
        pair = torch.cat([own[:, source], own[:, target], position[:, source] - position[:, target]], -1)
        messages = self.message(pair)
        received = torch.zeros(*x.shape[:2], messages.shape[-1]).index_add(1, target, messages)
        blocks = self.update(torch.cat([own, received], -1))
        return self.readout(blocks.mean(1)).squeeze(-1)


class LSTMMember(nn.Module):
    """One LSTM that reads a tower from the top block to the bottom one, then a readout."""

    def __init__(self, n_features: int, hidden: int, layers: int) -> None:
        super().__init__()
        self.lstm = nn.LSTM(n_features, hidden, num_layers=layers, batch_first=True)
        self.readout = nn.Sequential(nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))

    def forward(self, x: Tensor) -> Tensor:
        """[B, K, F] -> [B]."""
        states, _ = self.lstm(x.flip(1))
        return self.readout(states[:, -1]).squeeze(-1)


def plain_members(network: EnsembleNetwork, n_features: int, n_position: int) -> list[nn.Module]:
    """Each member of a stacked network as a plain module of the same weights."""
    weights = dict(network.named_parameters())
    members: list[nn.Module] = []
    for e in range(len(next(iter(weights.values())))):
        state = plain_names({name: weight.detach()[e] for name, weight in weights.items()})
        if isinstance(network, LSTMNetwork):
            layers, hidden = len(network.layers), len(state["readout.0.bias"])
            member: nn.Module = LSTMMember(n_features, hidden, layers)
            zeros = torch.zeros_like(state["lstm.bias_ih_l0"])
            state |= {f"lstm.bias_hh_l{layer}": zeros for layer in range(layers)}
        else:
            both_ways = isinstance(network, FCGN)
            hidden = len(state["readout.0.bias"])
            member = GraphMember(n_features - n_position, n_position, hidden, both_ways)
        member.load_state_dict(state)
        members.append(member)
    return members


def plain_names(stacked: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """What one member's weights (or their gradients) are called in its plain module, and in that module's layout.

    stacked: by name in the stacked network, without the axis of members: matrices [in, out], biases [1, out].
    """
    plain: dict[str, Tensor] = {}
    for name, tensor in stacked.items():
        layer, part = name.removeprefix("conv.").rsplit(".", 1)
        rows = tensor.T if part == "weight" else tensor[0]
        if layer.startswith("layers."):
            number, rows = layer.split(".")[1], _torch_gates(rows)
            if part == "weight":
                hidden = len(rows) // 4
                plain[f"lstm.weight_ih_l{number}"], plain[f"lstm.weight_hh_l{number}"] = rows.tensor_split([-hidden], 1)
            else:
                plain[f"lstm.bias_ih_l{number}"] = rows
            continue
        if (layer, part) == ("update_net.0", "weight"):  # the plain module has the features first, then the messages
            hidden = len(rows)
            rows = rows.roll(-hidden, 1)
        plain[f"{layer.replace('_net', '')}.{part}"] = rows.clone()
    return plain


def _torch_gates(rows: Tensor) -> Tensor:
    """Rows of gates [4H, ...], from (input, forget, output, candidate) to (input, forget, candidate, output)."""
    enter, forget, leave, candidate = rows.chunk(4)
    return torch.cat([enter, forget, candidate, leave])


# -- training -------------------------------------------------------------------------------------------------------


def prefix_samples(towers: Sequence[Tower], labels: Sequence[Sequence[int]]) -> Samples:
    """Every labelled prefix of two blocks or more, seen from four sides. labels: of each prefix; -1 has none."""
    x: dict[int, list[np.ndarray]] = {}
    y: dict[int, list[float]] = {}
    for tower, outcome in zip(towers, labels, strict=True):
        for view in four_views(tower):
            for length in range(2, len(tower) + 1):
                if outcome[length - 1] != -1:
                    x.setdefault(length, []).append(features(view[:length]))
                    y.setdefault(length, []).append(float(outcome[length - 1]))
    return {k: (torch.tensor(np.array(x[k]), dtype=torch.float32), torch.tensor(y[k])) for k in sorted(x)}


def train_epoch(member: nn.Module, optimiser: torch.optim.Optimizer, samples: Samples, rng: random.Random) -> None:
    """One pass over all samples, in batches of one length."""
    batches = []
    for length, (x, _) in samples.items():
        order = list(range(len(x)))
        rng.shuffle(order)
        batches += [(length, order[i : i + TRAINING_BATCH]) for i in range(0, len(order), TRAINING_BATCH)]
    rng.shuffle(batches)
    for length, rows in batches:
        x, y = samples[length]
        optimiser.zero_grad()
        loss = binary_cross_entropy_with_logits(member(x[rows]), y[rows])
        loss.backward()
        optimiser.step()


def mean_loss(member: nn.Module, samples: Samples) -> float:
    """Mean binary cross-entropy over all samples."""
    total, count = 0.0, 0
    with torch.no_grad():
        for x, y in samples.values():
            for i in range(0, len(x), SCORING_BATCH):
                rows = slice(i, i + SCORING_BATCH)
                total += binary_cross_entropy_with_logits(member(x[rows]), y[rows], reduction="sum").item()
            count += len(x)
    return total / count


def train(member: nn.Module, samples: Samples, validation: Samples, epochs: int, rng: random.Random) -> None:
    """Train one member; it ends with its weights of the lowest validation loss."""
    optimiser = torch.optim.Adam(member.parameters(), lr=1e-3)
    best_loss, best_state = float("inf"), member.state_dict()
    for _ in range(epochs):
        train_epoch(member, optimiser, samples, rng)
        loss = mean_loss(member, validation)
        if loss < best_loss:
            best_loss, best_state = loss, deepcopy(member.state_dict())
    member.load_state_dict(best_state)


# -- scores and plans -----------------------------------------------------------------------------------------------


def prefix_probabilities(members: Sequence[nn.Module], towers: Sequence[Tower]) -> Tensor:
    """[E, N, K - 1]: what each member says of prefixes 2..K of towers of one length."""
    x = torch.tensor(np.array([features(tower) for tower in towers]), dtype=torch.float32)
    with torch.no_grad():
        prefixes = [
            torch.stack([torch.sigmoid(member(x[:, :length])) for member in members])
            for length in range(2, x.shape[1] + 1)
        ]
    return torch.stack(prefixes, -1)


def expected_bald(members: Sequence[nn.Module], towers: Sequence[Tower]) -> list[float]:
    """[N]: the BALD of each prefix, weighted by the chance that those before it stand [nats]."""
    scores: list[float] = []
    for i in range(0, len(towers), SCORING_BATCH):
        p = prefix_probabilities(members, towers[i : i + SCORING_BATCH])
        score, attempted = torch.zeros(p.shape[1]), torch.ones(p.shape[1])
        for prefix in range(p.shape[2]):
            mean = p[:, :, prefix].mean(0)
            member_entropy = torch.stack([entropy(p_member) for p_member in p[:, :, prefix]]).mean(0)
            score += attempted * (entropy(mean) - member_entropy)
            attempted *= mean
        scores += score.tolist()
    return scores


def entropy(p: Tensor) -> Tensor:
    """Of a Bernoulli variable [nats], any shape."""
    return -(torch.xlogy(p, p) + torch.xlogy(1 - p, 1 - p))


def plan(
    members: Sequence[nn.Module], towers: Sequence[Tower], value: Callable[[Tower], float]
) -> tuple[int, float, float]:
    """The tower of highest expected value, the first among equals: its index, value and expected value."""
    best_index, best_value, best_expected = 0, 0.0, -1.0
    for i in range(0, len(towers), SCORING_BATCH):
        batch = towers[i : i + SCORING_BATCH]
        feasible = prefix_probabilities(members, batch).mean(0).prod(-1)
        for row, tower in enumerate(batch):
            tower_value = value(tower)
            expected = float(feasible[row]) * tower_value
            if expected > best_expected:
                best_index, best_value, best_expected = i + row, tower_value, expected
    return best_index, best_value, best_expected
