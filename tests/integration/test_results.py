"""What is published is what the published runs give: the analyses of `results`, once more."""

from pathlib import Path

import pytest

from integration.command_line import ANALYSIS, REPOSITORY, spawn

RESULTS = REPOSITORY / "results"
STRATEGIES, BASELINES, FLOOR = "runs/strategies", "runs/baselines", "runs/predictors/oracle*"
ANALYSES = {
    "regret.csv": ("plot_regret.py", STRATEGIES, BASELINES, FLOOR, "--out", "regret"),
    "active.csv": (
        "plot_regret.py",
        "runs/strategies/sequential*",
        "runs/baselines/random_ss*",
        FLOOR,
        "--out",
        "active",
        "--until",
        "400",
    ),
    "accuracy.csv": ("plot_accuracy.py", STRATEGIES, BASELINES, "--out", "accuracy"),
    "architectures.csv": ("plot_accuracy.py", "runs/architectures", "--out", "architectures"),
    "regret_table.csv": ("table_regret.py", STRATEGIES, BASELINES, "runs/predictors", "--out", "regret_table.csv"),
    "claims.csv": ("claims.py", "runs", "--notes", RESULTS / "notes.yaml", "--out", "claims.csv"),
    "claims.md": ("claims.py", "runs", "--notes", RESULTS / "notes.yaml", "--out", "claims.csv"),
    "early_stopping.csv": (
        "plot_regret.py",
        "runs/strategies/sequential*seed1[01]*",
        "trials/early_stopping/sequential*",
        FLOOR,
        "--out",
        "early_stopping",
        "--until",
        "400",
    ),
    "beyond/regret.csv": (
        "plot_beyond.py",
        "Ours=beyond/runs/beyond/*",
        "Nothing rehearsed=beyond/runs/unrehearsed/*",
        "The paper's way=runs/strategies/sequential*",
        "Floor of the search=beyond/runs/predictors/*",
        "Floor of the paper's planner=runs/predictors/oracle*",
        "--out",
        "beyond/regret",
    ),
    "packing/regret.csv": ("plot_regret.py", "packing/runs", "--out", "packing/regret"),
    "packing/accuracy.csv": ("plot_accuracy.py", "packing/runs", "--out", "packing/accuracy"),
    "packing/regret_table.csv": ("table_regret.py", "packing/runs", "--out", "packing/regret_table.csv"),
    "early_stopping_table.csv": ("table_regret.py", "trials/early_stopping", "--out", "early_stopping_table.csv"),
}
"""By the file that it writes: a script, patterns of folders of `results`, some with a NAME=, and options."""


@pytest.mark.slow
@pytest.mark.parametrize("file", ANALYSES)
def test_an_analysis_once_more(file: str, tmp_path: Path) -> None:
    script, *words = ANALYSES[file]
    end = words.index("--notes" if "--notes" in words else "--out")
    folders: list[Path | str] = []
    for word in words[:end]:
        name, _, pattern = word.rpartition("=")
        paths = sorted(RESULTS.glob(pattern))
        folders += [f"{name}={path}" for path in paths] if name else paths
    spawn([ANALYSIS / script, *folders, *words[end:]], cwd=tmp_path).must_work()
    assert (tmp_path / file).read_bytes() == (RESULTS / file).read_bytes()


@pytest.mark.slow
def test_what_the_robot_did_once_more(tmp_path: Path) -> None:
    run, out = RESULTS / "robot" / "panda_experiment", tmp_path / "statistics.csv"
    spawn([ANALYSIS / "table_robot.py", run, "--out", out], cwd=tmp_path).must_work()
    assert out.read_bytes() == (RESULTS / "robot" / "statistics.csv").read_bytes()
