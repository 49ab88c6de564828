"""Pictures of the plans that a run's last evaluation chose."""

from pathlib import Path

import pandas as pd

from apf.domain import Domain
from apf.rundir.claim import CHOSEN_TABLE


def plan_pictures(directory: Path, domain: Domain, folder: Path) -> dict[str, Path]:
    """Draws one chosen plan for each task: that of the first problem, in the first world.

    Args:
        directory: Of a finished run.
        domain: Of the run.
        folder: Gets the pictures.

    Returns:
        The files, by `chosen/TASK`. None where the domain draws no pictures, or nothing was chosen.
    """
    path = directory / CHOSEN_TABLE
    table = pd.read_parquet(path)
    rows = table[table["step"] == table["step"].max()].drop_duplicates("task").set_index(domain.plan_word)
    if rows.empty:
        return {}
    plans = {name: each.plans[i : i + 1] for each in domain.read_plans(path) for i, name in enumerate(each.names)}
    drawn = {}
    for name, row in rows.iterrows():
        picture = folder / f"chosen_{row['task']}.png"
        title = f"{row['task']} {row['value']:.3g}, chance {row['chance']:.2f}"
        if domain.save_picture(plans[name], picture, title):
            drawn[f"chosen/{row['task']}"] = picture
    return drawn


def curves(directory: Path) -> dict[str, Path]:
    """The pictures of a run's own curves, by `curves/NAME`."""
    return {f"curves/{path.stem}": path for path in sorted((directory / "figures").glob("*.png"))}
