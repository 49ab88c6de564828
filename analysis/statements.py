"""What the paper says of its simulated evaluation, as claims that a statistic decides."""

from functools import partial

from analysis import measures as m
from analysis.verdicts import Claim

ANALYTIC, SIMULATION = "predictor analytic", "predictor simulation"
HARD = ("overhang", "unsupported")

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
        towers=400,
    ),
    Claim(
        "4. Greedy is decent on tallest at 800 towers",
        "median regret at 800 towers",
        ("greedy",),
        partial(m.median_regret, who="greedy", task="tallest", towers=800),
        below=0.25,
        towers=800,
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
