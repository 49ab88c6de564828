"""The statistics that decide claims: functions of the evidence, each a single number."""

from collections.abc import Sequence

import numpy as np

from analysis.evidence import Evidence, MissingError

TASKS = ("tallest", "overhang", "unsupported")
STRATEGIES = ("sequential", "incremental", "complete", "greedy")
SETTLED = 200
"""Labelled towers from which on a strategy may be expected to have learned."""
TRAINED = (2, 3, 4, 5)
"""Lengths of the towers that models are trained on."""


# -- regret ---------------------------------------------------------------------------------------------------------


def median_regret(evidence: Evidence, *, who: str, task: str, towers: int | None = None) -> float:
    """Median over runs and problems.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        task: The name of a task.
        towers: Labelled towers at an evaluation; None: the last one.
    """
    at = last(evidence, who) if towers is None else towers
    return float(np.nanmedian(evidence.regrets(who, task, at)))


def above_floor(evidence: Evidence, *, who: str, task: str) -> float:
    """Median regret once settled, less that at the end.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        task: The name of a task.
    """
    at_end = median_regret(evidence, who=who, task=task)
    return median_regret(evidence, who=who, task=task, towers=SETTLED) - at_end


def mean_regret(evidence: Evidence, *, who: str, beside: Sequence[str] = (), tasks: Sequence[str] = TASKS) -> float:
    """Mean over tasks, runs, problems, and all evaluations that those beside it had, too.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        beside: Others that had the same evaluations.
        tasks: Names of tasks.
    """
    towers = evidence.common_towers(who, *beside)
    return float(np.mean([np.nanmean(evidence.regrets(who, task, n)) for task in tasks for n in towers]))


def less_regret(evidence: Evidence, *, who: str, than: str) -> float:
    """How much less mean regret the one has than the other.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        than: With what it is compared.
    """
    return mean_regret(evidence, who=than, beside=[who]) - mean_regret(evidence, who=who, beside=[than])


def harder(evidence: Evidence, *, task: str, than: str, who: str) -> float:
    """How much more mean regret one task leaves than another.

    Args:
        evidence: What the runs say.
        task: The name of a task.
        than: With what it is compared.
        who: A sampler, or a predictor that does not learn.
    """
    return mean_regret(evidence, who=who, tasks=[task]) - mean_regret(evidence, who=who, tasks=[than])


def worse_than_others(evidence: Evidence, *, who: str, task: str) -> float:
    """How much more mean regret a strategy has on a task than the worst of the others.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        task: The name of a task.
    """
    means = {name: mean_regret(evidence, who=name, beside=STRATEGIES, tasks=[task]) for name in STRATEGIES}
    return means.pop(who) - max(means.values())


def wider(evidence: Evidence, *, who: str, than: str, task: str) -> float:
    """How much farther apart the quartiles of regret are, once settled: mean over evaluations.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        than: With what it is compared.
        task: The name of a task.
    """
    return float(
        np.mean(
            [_spread(evidence, who, task, n) - _spread(evidence, than, task, n) for n in settled(evidence, who, than)]
        )
    )


def upper_quartile(evidence: Evidence, *, who: str, task: str) -> float:
    """The largest upper quartile of regret, once settled.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        task: The name of a task.
    """
    return max(float(np.nanquantile(evidence.regrets(who, task, n), 0.75)) for n in settled(evidence, who))


def relative_variance(evidence: Evidence, *, who: str) -> float:
    """A strategy's standard deviation between runs, once settled, as a share of the least of the others'."""
    towers = settled(evidence, *STRATEGIES)
    deviations = {
        name: np.mean([_of_runs(evidence, name, task, n).std(ddof=1) for task in TASKS for n in towers])
        for name in STRATEGIES
    }
    mine = deviations.pop(who)
    least = min(deviations.values())
    return float(mine / least) if least > 0 else np.nan


# -- standing -------------------------------------------------------------------------------------------------------


def standing(evidence: Evidence, *, who: str, tasks: Sequence[str] = TASKS, world: str = "noisy") -> float:
    """Share of the towers chosen at the end that stand in a world.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        tasks: Names of tasks.
        world: Where the chosen towers were built.
    """
    at = last(evidence, who)
    return float(np.mean([np.nanmean(evidence.stood(who, task, at, world)) for task in tasks]))


def stands_oftener(evidence: Evidence, *, who: str, than: str) -> float:
    """How much larger the share of the one that stands is, in the noisy world.

    Args:
        evidence: What the runs say.
        who: A sampler, or a predictor that does not learn.
        than: With what it is compared.
    """
    return standing(evidence, who=who) - standing(evidence, who=than)


# -- accuracy -------------------------------------------------------------------------------------------------------


def ahead(evidence: Evidence, *, who: str, of: str, lengths: Sequence[int] = TRAINED, only_end: bool = False) -> float:
    """How much more accurate one model is than another: over all evaluations, or at the end.

    Args:
        evidence: What the runs say.
        who: The name of a model.
        of: The model that it is compared with.
        lengths: Lengths of test towers.
        only_end: The last evaluation alone?
    """
    towers = evidence.common_towers(who, of)
    at = towers[-1:] if only_end else towers
    return _accuracy(evidence, who, lengths, at) - _accuracy(evidence, of, lengths, at)


def lead_grows(evidence: Evidence, *, who: str, of: str) -> float:
    """The lead on towers of 5 to 7 blocks, less that on pairs, at the end.

    Args:
        evidence: What the runs say.
        who: The name of a model.
        of: The model that it is compared with.
    """
    long, pairs = (ahead(evidence, who=who, of=of, lengths=lengths, only_end=True) for lengths in ((5, 6, 7), (2,)))
    return long - pairs


def lost_on(evidence: Evidence, *, who: str, length: int) -> float:
    """How much less accurate a model is on longer towers than on the longest that it was trained on, at the end.

    Args:
        evidence: What the runs say.
        who: The name of a model.
        length: The number of placements.
    """
    at = [last(evidence, who)]
    return _accuracy(evidence, who, TRAINED[-1:], at) - _accuracy(evidence, who, [length], at)


# -- shared ---------------------------------------------------------------------------------------------------------


def last(evidence: Evidence, *names: str) -> int:
    """Towers of the last evaluation that all of these had."""
    return evidence.common_towers(*names)[-1]


def settled(evidence: Evidence, *names: str) -> list[int]:
    """The evaluations that all of these had, once settled. Raises MissingError if there are none."""
    towers = [n for n in evidence.common_towers(*names) if n >= SETTLED]
    if not towers:
        raise MissingError(f"no evaluation of {', '.join(names)} from {SETTLED} towers on")
    return towers


def _spread(evidence: Evidence, who: str, task: str, towers: int) -> float:
    low, high = np.nanquantile(evidence.regrets(who, task, towers), [0.25, 0.75])
    return float(high - low)


def _of_runs(evidence: Evidence, who: str, task: str, towers: int) -> np.ndarray:
    """[R] mean regret of each run."""
    return np.nanmean(evidence.regrets(who, task, towers), axis=1)


def _accuracy(evidence: Evidence, model: str, lengths: Sequence[int], towers: Sequence[int]) -> float:
    return float(np.mean([evidence.accuracies(model, length, n).mean() for length in lengths for n in towers]))
