"""What a run shows when it ends: its curves as figures, and a summary on the terminal."""

from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from apf.planning.measures import MEASURES
from apf.report import figures
from apf.report.runs import words_of
from apf.rundir.kept import Summary, read_state


def save_figures(directory: Path) -> None:
    """Write the run's own curves beside its tables: regret; accuracy, AUC, NLL and ECE."""
    state = read_state(directory, Summary)
    words, group = words_of(state), str(state["choices"].get("sampler", directory.name))
    regret, accuracy = (
        pd.read_parquet(directory / f"{name}.parquet").assign(run=0, group=group) for name in ("regret", "accuracy")
    )
    curves = figures.regret_curves(regret)
    if len(curves):
        figures.save(figures.plot_regret(curves, words), curves.drop(columns="group"), directory / "figures" / "regret")
    if len(accuracy):
        measured = {name: figures.accuracy_curves(accuracy, name) for name in MEASURES if name in accuracy}
        table = figures.accuracy_curves(accuracy).drop(columns=["group", "mean", "min", "max"])
        table.insert(2, "accuracy", measured["accuracy"]["mean"])
        figures.save(figures.plot_measures(measured, words), table, directory / "figures" / "accuracy")


def print_summary(directory: Path, console: Console) -> None:
    """Wall time, regret and success for each world and task, accuracy and its like for each length, and the place."""
    seconds = read_state(directory, Summary)["seconds"]
    regret, accuracy = (pd.read_parquet(directory / f"{name}.parquet") for name in ("regret", "accuracy"))
    last = max([*regret["step"], *accuracy["step"]], default=0)
    regret, accuracy = regret[regret["step"] == last], accuracy[accuracy["step"] == last]
    plans = max([*regret["plans"], *accuracy["plans"]], default=0)
    console.print()
    console.print(Text.assemble((f"{plans} labelled plans", "bold"), f" in {_duration(seconds)}"))
    if len(regret):
        table = Table("world", "task", "median regret", "quartiles", "succeeded", box=None, pad_edge=False)
        regret = regret.sort_values("world", kind="stable")
        for names, group in regret.groupby(["world", "task"], sort=False):
            low, median, high = group["regret"].quantile([0.25, 0.5, 0.75])
            standing = f"{group['feasible'].sum()} of {len(group)}"
            table.add_row(*map(str, names), f"{median:.3f}", f"{low:.3f} to {high:.3f}", standing)
        console.print(table)
    if len(accuracy):
        table = Table("length", *map(str, accuracy["length"]), box=None, pad_edge=False)
        for name in MEASURES:
            if name in accuracy:  # tables of earlier versions lack some
                table.add_row(
                    name if name == "accuracy" else name.upper(), *(f"{value:.3f}" for value in accuracy[name])
                )
        console.print(table)
    console.print("tables, figures, weights and journal:")
    console.print(str(directory))


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
