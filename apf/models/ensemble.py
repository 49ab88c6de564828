"""An ensemble of networks that predicts the feasibility of plans (Section Abstract plan feasibility model)."""

import copy
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from apf.domain import Domain, Kind, Labelled, Predictor
from apf.models.batches import last_only
from apf.models.examples import Examples, examples
from apf.models.kernels import passes_of
from apf.models.layers import EnsembleNetwork
from apf.models.passes import Passes
from apf.models.training import History, Training, fit
from apf.rng import torch_generator
from apf.settings import Few, settings

CHUNK = 6144
"""Pairs of placements that one member predicts together: activations then stay in the cache."""

SOME = 256
"""Examples of a length that tell whether a member is dead."""

FEW = 2048
"""Pairs of placements that all members predict together: to start operations for each takes longer than to compute."""

RESTARTS = 5
"""How often a dead member is started again at most."""

SPREAD = 0.01
"""A member is dead if its logits of all examples of a length lie in a smaller range than this. Of others: over 5."""

TINY = 1e-12
"""Least probability, and least distance of a probability from 1, of which a logit is taken."""

ON_GPU = 2**20
"""Pairs of placements, counted for each member, that a GPU predicts together: an activation then takes 256 MiB."""


@settings
class EnsembleSettings:
    """How many networks, and of which architecture."""

    members: Few
    """N in the paper: theta_1 .. theta_N."""
    network: Callable[..., EnsembleNetwork]
    """Makes the stacked network, given `members`, `n_features` and `n_position`."""
    kernels: bool = True
    """Use passes written out by hand, where the network has some (`apf/models/kernels`)?"""


class Ensemble(Predictor):
    """N networks of one architecture, trained on the same plans from different starts: Pr(Theta | D).

    Weights are stacked, so all members train as one network.

    Args:
        settings: the number of members, and their architecture.
        kind: what the outputs mean, Theta_comp or Theta_ss.
        domain: computes the features of plans.
        training: how members are trained.
        device: where the networks are computed.
        odds: factor for the odds of success in `feasibility` and `last_feasibility`.
    """

    def __init__(
        self,
        settings: EnsembleSettings,
        kind: Kind,
        domain: Domain,
        training: Training,
        device: torch.device,
        odds: float = 1.0,
    ) -> None:
        self.members = settings.members
        self.kind = kind
        self.by_prefix = kind is Kind.SUBSEQUENCE
        self.domain = domain
        self.training = training
        self.odds = odds
        self.pessimism: float | None = None
        self.device = device
        self.together = device.type != "cpu"
        self._settings = settings
        self.passes = self._untrained(settings.members)
        self.network = self.passes.network
        self._some = self._untrained(1)  # takes the weights of the members that predict

    def fit(self, train: Sequence[Labelled], validation: Sequence[Labelled], rng: np.random.Generator) -> History:
        """Train all members from scratch, each with its own start and order of examples.

        Args:
            train: labelled plans to train on.
            validation: labelled plans for early stopping; without early stopping, they are trained on, too.
            rng: for initial weights and the order of examples.

        A member can die: all its units of a layer are 0 for every plan, so that it says the same of each plan and no
        gradient reaches its weights. Such a member is trained again from another start.

        Returns:
            The losses.

        Raises:
            FloatingPointError: a loss is not finite.
        """
        if not self.training.early_stopping:
            train, validation = [*train, *validation], []
        parts = tuple(examples(part, self.kind, self.domain) for part in (train, validation))
        plans = sum(len(group.labels) for group in train)
        history = self._fit(self.passes, parts, plans, rng)
        for _ in range(RESTARTS):
            dead = self.dead(parts[0])
            if not len(dead):
                break
            passes = self._untrained(len(dead))
            history = history.replaced(dead, self._fit(passes, parts, plans, rng))
            for ours, theirs in zip(self.network.parameters(), passes.network.parameters(), strict=True):
                ours.data[dead] = theirs.data
        return history

    def dead(self, groups: Sequence[Examples]) -> np.ndarray:
        """[M] numbers of the members that say the same of all these examples of a length, of the first ones if many.

        Args:
            groups: Examples, one group for each length.
        """
        spread = np.zeros(self.members)
        with torch.inference_mode():
            for group in groups:
                x = torch.from_numpy(group.x[:SOME]).to(self.device)
                prepared = self.passes.prepare(x[None], last_only(x, group.y))
                spread = np.maximum(spread, np.ptp(self.passes.logits(prepared).numpy(force=True), 1).max(1))
        return np.flatnonzero(spread < SPREAD)

    def _untrained(self, members: int) -> Passes:
        """The passes of so many networks, whose weights are not set."""
        sizes = {"n_features": self.domain.n_features, "n_position": self.domain.n_position}
        network = self._settings.network(members=members, **sizes).to(self.device)
        return passes_of(network, self._settings.kernels)

    def _fit(
        self, passes: Passes, parts: tuple[Sequence[Examples], ...], plans: int, rng: np.random.Generator
    ) -> History:
        """Train networks from scratch on training and validation examples, the views of so many plans."""
        members = len(passes.parameters[0])
        *generators, length_generator = (torch_generator(rng) for _ in range(members + 1))
        passes.network.reset(generators)
        train, validation = parts
        return fit(passes, train, validation, self.training, generators, length_generator, plans)

    def predict(self, plans: Any) -> Tensor:
        """[E, N, P] float64 probabilities of each member for each plan; on the ensemble's device, if it has this type.

        Theta_ss: P = K - 1, the probability that prefix 2..K is feasible given that those before it were.
        Theta_comp: P = 1, the probability that the whole plan is.
        """
        return self._predict(plans, last_only=self.kind is Kind.COMPLETE)

    def feasibility(self, plans: Any, rng: np.random.Generator | None = None) -> np.ndarray:
        """[N] probability that the whole plan is feasible: the mean over members for each output, then their product.

        Under Theta_ss that is eq. (theta-ss); the first placement is feasible by assumption. Draws nothing.
        """
        p = self._predict(plans, last_only=self.kind is Kind.COMPLETE, odds=self.odds)
        return self._joined(p).prod(1)

    def last_feasibility(self, plans: Any, members: slice = slice(None)) -> np.ndarray:
        """[N] mean over these members of the probability that the last placement succeeds.

        Under Theta_ss given that all placements before the last one succeeded; under Theta_comp that of the whole plan.
        """
        p = self._predict(plans, last_only=True, members=members, odds=self.odds)
        return self._joined(p)[:, 0]

    def prefix_deviation(self, plans: Any) -> np.ndarray:
        """As `Predictor.prefix_deviation`, with the odds of this ensemble."""
        n, k = len(plans), plans.length
        chances = np.ones((self.members, n, k))
        if self.kind is Kind.SUBSEQUENCE and k > 1:
            p = self._predict(plans, last_only=False, odds=self.odds)
            chances[..., 1:] = p.numpy(force=True).cumprod(-1)
        for length in range(2, k + 1) if self.kind is Kind.COMPLETE else ():
            p = self._predict(plans.prefix(length), last_only=True, odds=self.odds)
            chances[..., length - 1] = p.numpy(force=True)[..., 0]
        return chances.std(0)

    def with_odds(self, odds: float) -> Self:
        """The same networks, whose weights are shared, with another factor for the odds of each placement."""
        other = copy.copy(self)
        other.odds = odds
        return other

    def with_pessimism(self, pessimism: float | None) -> Self:
        """As `Predictor.with_pessimism`. The weights of the networks are shared."""
        other = copy.copy(self)
        other.pessimism, other.mean_of_members = pessimism, pessimism is None
        return other

    def save(self, path: Path) -> None:
        """Write the weights as safetensors. Raises OSError if that cannot be done."""
        try:
            save_file({name: weight.contiguous() for name, weight in self.network.state_dict().items()}, path)
        except SafetensorError as error:
            raise OSError(f"{path}: cannot be written: {error}") from None

    def load(self, path: Path) -> None:
        """Read weights that `save` wrote."""
        self.network.load_state_dict(load_file(path, device=str(self.device)))

    def _joined(self, p: Tensor) -> np.ndarray:
        """[E, N, P] -> [N, P] what the members say together."""
        return _mean(p) if self.pessimism is None else _least(p.numpy(force=True), self.pessimism)

    def _predict(self, plans: Any, last_only: bool, members: slice = slice(None), odds: float = 1.0) -> Tensor:
        """[members, N, K - 1], or [members, N, 1] if `last_only`; each probability with its odds multiplied."""
        chosen = range(self.members)[members]
        logits = torch.empty(len(chosen), len(plans), 1 if last_only else plans.length - 1, device=self.device)
        if not len(plans):
            return _doubles(logits)
        size, at_once = self._portions(len(plans), math.comb(plans.length, 2), len(chosen))
        groups = [chosen[i : i + at_once] for i in range(0, len(chosen), at_once)]
        weights, stacks = self._some.parameters, [stack.data for stack in self.passes.parameters]
        with torch.inference_mode():
            for part, of_part in zip(self._features(plans, size), logits.split(size, 1), strict=True):
                prepared = self.passes.prepare(part[None], last_only)
                for group, of_group in zip(groups, of_part.split(at_once), strict=True):
                    for weight, stack in zip(weights, stacks, strict=True):
                        weight.data = stack[group.start : group.stop]
                    of_group.copy_(self._some.logits(prepared))
        return _doubles(logits).add_(math.log(odds)).sigmoid_()

    def _features(self, plans: Any, size: int) -> Iterable[Tensor]:
        """Features [size or fewer, K, F] of some plans after others, on the device.

        While a GPU predicts some plans, the CPU computes the features of the next ones.
        """
        if self.device.type == "cpu":
            return torch.from_numpy(self.domain.features(plans)).split(size)
        parts = (plans[start : start + size] for start in range(0, len(plans), size))
        return (torch.from_numpy(self.domain.features(part)).to(self.device) for part in parts)

    def _portions(self, plans: int, pairs: int, members: int) -> tuple[int, int]:
        """How many plans, and how many members, are computed at once.

        On a CPU, all members predict few plans together; many plans are predicted in chunks that keep activations in
        the cache, by one member after another. A GPU computes as much at once as memory allows.
        """
        if self.device.type != "cpu":
            return max(1, ON_GPU // (pairs * members)), members
        if plans * pairs <= FEW:
            return plans, members
        return max(CHUNK // pairs, 256), 1


def _mean(p: Tensor) -> np.ndarray:
    """[E, N, P] -> [N, P] mean over members. NumPy's does not depend on N; a GPU's spares moving all of p."""
    return p.numpy().mean(0) if p.device.type == "cpu" else p.mean(0).numpy(force=True)


def _least(p: np.ndarray, deviations: float) -> np.ndarray:
    """[E, N, P] -> [N, P] probability whose logit is the members' mean logit less so many standard deviations of it."""
    p = p.clip(TINY, 1 - TINY)
    logits = np.log(p) - np.log1p(-p)
    return np.asarray(1 / (1 + np.exp(deviations * logits.std(0) - logits.mean(0))))


def _doubles(x: Tensor) -> Tensor:
    """In float64, on the CPU if the device lacks it, as Apple's does."""
    return x.to("cpu" if x.device.type == "mps" else x.device, torch.float64)


def pick_device(name: str) -> torch.device:
    """The device of that name; `auto` is an NVIDIA or AMD GPU where there is one that can compute, else the CPU.

    Raises RuntimeError if there is no such device, or none that can compute.
    """
    if name == "auto":
        return torch.device("cuda" if _computes(torch.device("cuda")) else "cpu")
    device = torch.device(name)
    if device.type not in ("cpu", "cuda", "mps", "xpu"):
        raise RuntimeError("it must be auto, cpu, cuda, mps or xpu")
    torch.ones(1, device=device).add_(1).tolist()
    return device


def _computes(gpu: torch.device) -> bool:
    """Is there such a GPU, and one that this build of PyTorch has operations for? Says why not, if there is one."""
    if not torch.cuda.is_available():
        return False
    try:
        return torch.ones(1, device=gpu).add_(1).tolist() == [2.0]
    except (RuntimeError, AssertionError) as error:
        reason = next(iter(str(error).splitlines()), "")
        print(f"the GPU cannot be used, going on without it: {reason}", file=sys.stderr, flush=True)
        return False
