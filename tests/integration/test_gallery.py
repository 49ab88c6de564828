"""analysis/plot_towers.py: pictures of the towers that evaluations chose."""

import sys
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.patches import Polygon

from analysis.plot_towers import gallery, main
from apf.errors import InputError
from apf.report.runs import find_runs
from integration.command_line import TINY, call

pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.fixture
def run(here: Path) -> Path:
    """A run of which the last evaluation chose towers of three blocks for three problems."""
    more = ("evaluation.problems=3", "evaluation.length=3", "hydra.run.dir=run")
    call(*TINY, *more).must_work()
    return here / "run"


def test_a_row_for_each_task_and_a_tower_for_each_problem(run: Path) -> None:
    (found,), _ = find_runs([run])
    figure = gallery(found, "noisy", 10)
    assert len(figure.axes) == 3 * 3
    table = pd.read_parquet(run / "evaluation_plans.parquet")
    last = table[(table["step"] == table["step"].max()) & (table["world"] == "noisy")]
    solid = sum(isinstance(p, Polygon) and p.get_facecolor()[3] == 1 for ax in figure.axes for p in ax.patches)
    outlined = sum(isinstance(p, Polygon) and p.get_facecolor()[3] == 0 for ax in figure.axes for p in ax.patches)
    assert solid == 3 * (last["label"] == 1).sum()
    assert outlined == 3 * (last["label"] != 1).fillna(True).sum()
    assert len(gallery(found, None, 2).axes) == 3 * 2
    with pytest.raises(InputError, match=r"world is panda; .* has analytic, noisy"):
        gallery(found, "panda", 1)


def test_the_script(run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(sys, "argv", ["plot_towers.py", str(run), "--number", "1"])
    main()
    assert (run / "figures" / "towers.png").stat().st_size > 5000
    monkeypatch.setattr(sys, "argv", ["plot_towers.py", str(run), "--world", "moon", "--out", "out.png"])
    with pytest.raises(SystemExit, match="error: world is moon"):
        main()
    assert not Path("out.png").exists()


def test_packings_are_no_towers(here: Path) -> None:
    call(*TINY, "domain=packing", "hydra.run.dir=run").must_work()
    (found,), _ = find_runs([here / "run"])
    with pytest.raises(InputError, match="holds no towers"):
        gallery(found, None, 1)
