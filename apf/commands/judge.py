"""Who is asked how likely a plan succeeds: the ensemble of a run, or a predictor that knows the physics."""

from pathlib import Path

from apf.domain import Domain, Predictor
from apf.errors import InputError
from apf.trained import load_ensemble, shipped_for


def judge_of(
    run: Path | None,
    step: int | None,
    predictor: Predictor | None,
    domain: Domain,
    odds: float = 1.0,
    device: str = "auto",
) -> Predictor:
    """The predictor that is chosen, or else the ensemble of a run.

    Args:
        run: A run directory; None: of the ensemble that comes with the package for this domain.
        step: One of its evaluated steps; None: the last.
        predictor: If it is chosen instead of a run.
        domain: Of the plans.
        odds: Factor for the odds of each placement.
        device: Of the ensemble.

    Raises:
        InputError: There is none, the run keeps no ensemble, or one of the two is for another domain.
    """
    if predictor is not None:
        theirs = predictor.for_domain
        if theirs is not None and not isinstance(domain, theirs):
            name = f"{type(predictor).__name__}, which is for {theirs.__name__}"
            raise InputError(f"predictor is {name}; domain is {type(domain).__name__}")
        return predictor.with_odds(odds)
    run = run or shipped_for(domain)
    if run is None:
        which = f"no ensemble for {type(domain).__name__} comes with apf"
        raise InputError(f"run is missing: a finished run's directory ({which}); or predictor=analytic or simulation")
    ensemble = load_ensemble(run, step, odds, device)
    if type(ensemble.domain) is not type(domain):
        raise InputError(f"run: {run} is a run of {type(ensemble.domain).__name__}; domain is {type(domain).__name__}")
    return ensemble
