"""The paper's claims about its simulated evaluation, each with the statistic that decides it, as a table.

    python analysis/claims.py results/runs --notes results/notes.yaml --out results/claims.csv

A statistic's interval holds the middle 95 % of a bootstrap over runs and problems. A claim holds if the whole interval
is on its side of the bound, fails if all of it is on the other side, and is undecided otherwise.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import measures as m
from analysis.commands import finished_runs, one_line_errors, parser_of
from analysis.evidence import Evidence, MissingError
from apf.errors import InputError
from apf.rundir.files import read_yaml

COLUMNS = ["claim", "paper", "statistic", "value", "low", "high", "runs", "verdict", "note"]
ANALYTIC, SIMULATION = "predictor analytic", "predictor simulation"
HARD = ("overhang", "unsupported")
ENOUGH = 2
"""Runs of what learns, at least, without which nothing is decided."""


@dataclass(frozen=True)
class Claim:
    """A claim, and what decides it: `measure`, what `statistic` says in words, above or below a bound.

    names: whose runs decide it.
    """

    text: str
    statistic: str
    names: tuple[str, ...]
    measure: Callable[[Evidence], float]
    above: float | None = None
    below: float | None = None

    @property
    def rule(self) -> str:
        """The statistic and its bound."""
        return f"{self.statistic} > {self.above:g}" if self.above is not None else f"{self.statistic} < {self.below:g}"

    def decide(self, evidence: Evidence, draws: int, rng: np.random.Generator) -> dict[str, object]:
        """Value, interval, number of runs, verdict and note: the columns of the table from `value` on.

        Args:
            evidence: What the runs say.
            draws: Bootstrap samples.
            rng: The source of all draws.
        """
        runs = " + ".join(str(len(evidence.runs.get(name, ()))) for name in self.names)
        try:
            value = self.measure(evidence)
        except MissingError as missing:
            nothing = dict.fromkeys(("value", "low", "high"), np.nan)
            return {**nothing, "runs": runs, "verdict": "undecided", "note": str(missing)}
        low, high = np.nanquantile([self.measure(evidence.drawn(rng)) for _ in range(draws)], [0.025, 0.975])
        few = [name for name in self.names if name not in (ANALYTIC, SIMULATION) and len(evidence.runs[name]) < ENOUGH]
        verdict = "undecided" if few else self.verdict(low, high)
        note = f"too few runs of {', '.join(few)} to tell how much they differ" if few else ""
        return {"value": value, "low": low, "high": high, "runs": runs, "verdict": verdict, "note": note}

    def verdict(self, low: float, high: float) -> str:
        """Does the claim hold, if its statistic is somewhere from low to high?"""
        if self.above is not None:
            return "holds" if low > self.above else "fails" if high < self.above else "undecided"
        bound = self.below if self.below is not None else np.inf
        return "holds" if high < bound else "fails" if low > bound else "undecided"


STRATEGY = [
    Claim(
        "1. Sequential brings regret on tallest near its floor after about 200 towers",
        "median regret at 200 towers less that at the end",
        ("sequential",),
        partial(m.above_floor, who="sequential", task="tallest"),
        below=0.05,
    ),
    Claim(
        "2. Incremental does so with the least variance between runs",
        "standard deviation over runs of mean regret from 200 towers on, as a share of the least of the others'",
        m.STRATEGIES,
        partial(m.relative_variance, who="incremental"),
        below=1.0,
    ),
    *(
        Claim(
            f"3. Complete has far wider quartiles than sequential ({task})",
            "distance of the quartiles from 200 towers on, complete less sequential",
            ("complete", "sequential"),
            partial(m.wider, who="complete", than="sequential", task=task),
            above=0.1,
        )
        for task in HARD
    ),
    *(
        Claim(
            f"3. The upper quartile of complete reaches 1 ({task})",
            "largest upper quartile of regret from 200 towers on",
            ("complete",),
            partial(m.upper_quartile, who="complete", task=task),
            above=0.99,
        )
        for task in HARD
    ),
    *(
        Claim(
            f"4. Greedy is worst ({task})",
            "mean regret less that of the worst other strategy",
            m.STRATEGIES,
            partial(m.worse_than_others, who="greedy", task=task),
            above=0.0,
        )
        for task in m.TASKS
    ),
    Claim(
        "4. Greedy is not yet decent on tallest at 400 towers",
        "median regret at 400 towers",
        ("greedy",),
        partial(m.median_regret, who="greedy", task="tallest", towers=400),
        above=0.25,
    ),
    Claim(
        "4. Greedy is decent on tallest at 800 towers",
        "median regret at 800 towers",
        ("greedy",),
        partial(m.median_regret, who="greedy", task="tallest", towers=800),
        below=0.25,
    ),
    *(
        Claim(
            f"5. {task.capitalize()} is harder than tallest",
            "mean regret of sequential, less that on tallest",
            ("sequential",),
            partial(m.harder, task=task, than="tallest", who="sequential"),
            above=0.0,
        )
        for task in HARD
    ),
    *(
        Claim(
            f"5. Sequential ends with low regret ({task})",
            "median regret at the end",
            ("sequential",),
            partial(m.median_regret, who="sequential", task=task),
            below=0.2,
        )
        for task in HARD
    ),
]
RANDOM = [
    Claim(
        f"{number}. {one.capitalize()} beats {other}",
        "mean regret of the latter less that of the former",
        (one, other),
        partial(m.less_regret, who=one, than=other),
        above=0.0,
    )
    for number, one, other in (
        (6, "sequential", "random_ss"),
        (6, "incremental", "random_ss"),
        (6, "random_ss", "greedy"),
        (7, "complete", "random_comp"),
    )
]
MODEL = [
    *(
        Claim(
            f"8. {one.upper()} {verb} {other.upper()}",
            f"accuracy on 2 to 5 blocks over all evaluations, {one.upper()} less {other.upper()}",
            (one, other),
            partial(m.ahead, who=one, of=other),
            above=0.0,
        )
        for one, verb, other in (
            ("tgn", "beats", "lstm"),
            ("fcgn", "beats", "lstm"),
            ("tgn", "learns faster than", "fcgn"),
        )
    ),
    Claim(
        "8. TGN's lead over LSTM grows with length",
        "lead on 5 to 7 blocks less lead on 2, at the end",
        ("tgn", "lstm"),
        partial(m.lead_grows, who="tgn", of="lstm"),
        above=0.0,
    ),
    Claim(
        "8. FCGN catches up",
        "accuracy on 2 to 5 blocks at the end, TGN less FCGN",
        ("tgn", "fcgn"),
        partial(m.ahead, who="tgn", of="fcgn", only_end=True),
        below=0.03,
    ),
    *(
        Claim(
            f"9. TGN trained on up to 5 blocks generalises to {length}",
            f"accuracy on 5 blocks less that on {length}, at the end",
            ("tgn",),
            partial(m.lost_on, who="tgn", length=length),
            below=0.1,
        )
        for length in (6, 7)
    ),
]
PREDICTOR = [
    *(
        Claim(
            f"10. Analytic plans have high value if they stand ({task})",
            "median regret in the world without noise",
            (ANALYTIC,),
            partial(m.median_regret, who=ANALYTIC, task=task),
            below=0.01,
        )
        for task in m.TASKS
    ),
    *(
        Claim(
            f"10. Analytic plans fall often in the noisy world ({task})",
            "share that stands",
            (ANALYTIC,),
            partial(m.standing, who=ANALYTIC, tasks=(task,)),
            below=0.75,
        )
        for task in m.TASKS
    ),
    Claim(
        "10. Learned plans stand oftener than analytic ones",
        "share that stands in the noisy world, learned (sequential) less analytic",
        ("sequential", ANALYTIC),
        partial(m.stands_oftener, who="sequential", than=ANALYTIC),
        above=0.0,
    ),
    Claim(
        "10. Learned plans stand as often as simulated-noise ones, or oftener",
        "share that stands in the noisy world, learned (sequential) less simulation",
        ("sequential", SIMULATION),
        partial(m.stands_oftener, who="sequential", than=SIMULATION),
        above=-0.03,
    ),
]
CLAIMS = {
    "Impact of Sampling Strategy": STRATEGY,
    "appendix, Supervised vs Active Learning": RANDOM,
    "Model Architecture and Generalization": MODEL,
    "Real Robot Experiments, here in noisy simulation": PREDICTOR,
}
"""By the section of the paper that makes them."""


def table_of_claims(evidence: Evidence, draws: int) -> pd.DataFrame:
    """One row for each claim, in COLUMNS."""
    rng = np.random.default_rng(0)
    rows = [
        {"claim": claim.text, "paper": section, "statistic": claim.rule, **claim.decide(evidence, draws, rng)}
        for section, claims in CLAIMS.items()
        for claim in claims
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def add_notes(table: pd.DataFrame, path: Path) -> None:
    """Put what is known about claims, a YAML file of notes by claim, into the table.

    Raises InputError for a claim that is not in the table.
    """
    notes = read_yaml(path)
    for claim, note in notes.items():
        rows = table["claim"] == claim
        if not rows.any():
            raise InputError(f"{path}: no such claim: {claim}")
        table.loc[rows, "note"] = [f"{missing}; {note}" if missing else note for missing in table.loc[rows, "note"]]


def main() -> None:
    """Write the table of claims for the runs on the command line."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=Path("claims.csv"), help="CSV to write (default: %(default)s)")
    parser.add_argument("--notes", type=Path, help="YAML file with notes by claim, for the last column")
    parser.add_argument("--draws", type=int, default=1000, help="bootstrap samples (default: %(default)s)")
    arguments = parser.parse_args()
    with one_line_errors():
        table = table_of_claims(Evidence.of(finished_runs(arguments.directories)), arguments.draws)
        if arguments.notes:
            add_notes(table, arguments.notes)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(arguments.out, index=False, float_format="%.3f")
    for verdict, claim in zip(table["verdict"], table["claim"]):
        print(f"{verdict:10} {claim}")
    print(arguments.out)


if __name__ == "__main__":
    main()
