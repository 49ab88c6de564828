"""The run directory is the truth: every file, column and number in it."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir

from apf.commands.run import make_model
from apf.config.values import config_dir
from apf.domain import Kind
from apf.planning import Evaluator, regret_table
from apf.rundir.store import Store
from apf.schema import validate
from apf.towers import NoisyWorld, read_towers, standing_prefixes
from apf.towers.files import TOWER_COLUMNS
from integration.command_line import SMOKE, TINY, Result, call

REGRET = [
    "step",
    "plans",
    "task",
    "problem",
    "world",
    "value",
    "chance",
    "best_value",
    "regret",
    "feasible",
    "search_value",
    "search_regret",
]
ACCURACY = ["step", "plans", "length", "accuracy", "auc", "nll", "ece", "n"]
TASKS = ["tallest", "overhang", "unsupported"]
WORLDS = ["analytic", "noisy"]
PLACEMENTS = [
    *("tower", "position", "step", "split", "score", "label", "note"),
    *("block", "dim_x", "dim_y", "dim_z", "com_x", "com_y", "com_z", "mass"),
    *("x", "y", "z", "qx", "qy", "qz", "qw"),
]


def journal(directory: Path) -> pd.DataFrame:
    """A row for each tower: as `Store` reads the journal, and `labelled_at`."""
    records = [json.loads(line) for line in (directory / "journal.jsonl").read_text().splitlines()]
    towers = [
        {"step": record["step"], **plan} for record in records if record["kind"] == "plans" for plan in record["plans"]
    ]
    for record in records:
        if record["kind"] == "label":
            towers[record["plan"]] |= {"labels": record["labels"], "labelled_at": record["at"]}
    return pd.DataFrame(towers).astype({"score": float}).rename_axis("id").reset_index()


@pytest.mark.slow
def test_every_file_is_there(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    found = {str(path.relative_to(directory)) for path in directory.rglob("*") if path.is_file()}
    weights = {f"weights/step_{step:04d}.safetensors" for step in (1, 2)}
    figures = {f"figures/{name}{end}" for name in ("regret", "accuracy") for end in (".png", ".pdf", ".csv")}
    tables = {f"{name}.parquet" for name in ("plans", "regret", "accuracy", "evaluation_plans")}
    blocks = {"training_blocks.csv", "evaluation_blocks.csv"}
    assert found == weights | figures | tables | blocks | {
        "config.yaml",
        "run.yaml",
        "run.log",
        "journal.jsonl",
        "lock",
    }
    assert not list(directory.rglob("*.pkl"))


@pytest.mark.slow
def test_config_is_resolved_and_whole(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    text = (directory / "config.yaml").read_text()
    assert "${" not in text
    with initialize_config_dir(config_dir(), version_base="1.3"):
        cfg = compose("config", list(SMOKE))
    config = yaml.safe_load(text)
    assert set(config) == set(cfg)
    assert config["domain"]["evaluation"]["side"] == [0.05, 0.15]
    assert config["sampler"]["candidates"]["n"] == 1000
    assert config["plans"] == 40


@pytest.mark.slow
def test_run_says_how_it_came_to_be(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    state = yaml.safe_load((directory / "run.yaml").read_text())
    assert state["finished"] is True
    assert 0 < state["seconds"] < 300
    assert state["choices"]["sampler"] == "sequential"
    assert state["choices"]["experiment"] == "smoke"
    assert state["choices"]["task"] == TASKS
    assert state["overrides"] == list(SMOKE)
    assert state["versions"]["torch"] == torch.__version__


@pytest.mark.slow
def test_log_holds_the_lines_of_the_terminal(smoke: tuple[Path, Result]) -> None:
    directory, result = smoke
    logged = [line.split(" ", 2)[2] for line in (directory / "run.log").read_text().splitlines()]
    assert logged
    assert "\n".join(logged) in result.err


@pytest.mark.slow
def test_regret_table(smoke: tuple[Path, Result]) -> None:
    table = pd.read_parquet(smoke[0] / "regret.parquet")
    assert list(table.columns) == REGRET
    expected = [
        (step, towers, task, problem, world)
        for step, towers in ((1, 30), (2, 40))
        for problem in range(2)
        for task in TASKS
        for world in WORLDS
    ]
    assert list(table[["step", "plans", "task", "problem", "world"]].itertuples(index=False, name=None)) == expected
    assert table["feasible"].dtype == bool
    assert table["regret"].notna().any()
    known = table.dropna(subset=["regret"])
    reward = known["value"] * known["feasible"]
    assert ((known["best_value"] - reward) / known["best_value"] == known["regret"]).all()
    assert known["regret"].between(0, 1).all()
    assert (table["value"] > 0).all()
    problems = table.groupby(["task", "problem"])["best_value"]
    assert (problems.nunique() == 1).all(), "the problems are the same at every step"


@pytest.mark.slow
def test_accuracy_table(smoke: tuple[Path, Result]) -> None:
    table = pd.read_parquet(smoke[0] / "accuracy.parquet")
    assert list(table.columns) == ACCURACY
    expected = [(step, towers, k) for step, towers in ((1, 30), (2, 40)) for k in (2, 3, 4, 5)]
    assert list(table[["step", "plans", "length"]].itertuples(index=False, name=None)) == expected
    assert (table["n"] == 20).all()
    assert table["accuracy"].between(0, 1).all()
    assert table[["auc", "ece"]].apply(lambda values: values.between(0, 1)).all(axis=None)
    assert (table["nll"] > 0).all()
    assert np.allclose(table["accuracy"] * 20, (table["accuracy"] * 20).round())


@pytest.mark.slow
def test_journal_has_a_row_for_every_tower(smoke: tuple[Path, Result]) -> None:
    rows = journal(smoke[0])
    assert rows["id"].tolist() == list(range(40))
    assert rows["step"].tolist() == [0] * 20 + [1] * 10 + [2] * 10
    assert rows["labels"].str.fullmatch("1+|1+0-*").all()
    assert rows["labelled_at"].is_monotonic_increasing
    assert rows["score"].isna().tolist() == [True] * 20 + [False] * 20
    assert rows.groupby("step")["score"].apply(lambda scores: scores.dropna().is_monotonic_decreasing).all()
    splits = rows.groupby("step")["split"].value_counts().unstack()
    assert splits["train"].tolist() == [12, 8, 8]
    assert splits["validation"].tolist() == [8, 2, 2]


@pytest.mark.slow
def test_towers_table_holds_every_placement_of_the_journal(smoke: tuple[Path, Result]) -> None:
    directory, _ = smoke
    table, rows = pd.read_parquet(directory / "plans.parquet"), journal(directory)
    assert list(table.columns) == PLACEMENTS
    assert len(table) == rows["labels"].str.len().sum()
    for number, group in table.groupby("tower"):
        row = rows.iloc[number]
        assert group["position"].tolist() == list(range(len(row["labels"])))
        labels = ["-" if label is pd.NA else str(label) for label in group["label"]]
        assert "".join(labels) == row["labels"]
        assert set(group["split"]) == {row["split"]}
        assert set(group["step"]) == {row["step"]}
        assert group["score"].isna().all() if math.isnan(row["score"]) else set(group["score"]) == {row["score"]}
        assert group["block"].is_unique


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_towers_table_cut_to_a_tower_file_reads_back(smoke: tuple[Path, Result], tmp_path: Path, ending: str) -> None:
    table = pd.read_parquet(smoke[0] / "plans.parquet")
    path = tmp_path / f"towers{ending}"
    cut = table[TOWER_COLUMNS]
    cut.to_csv(path, index=False) if ending == ".csv" else cut.to_parquet(path, index=False)
    batches = read_towers(path)
    assert sorted(name for batch in batches for name in batch.names) == list(range(40))
    for batch in batches:
        for name, xy, z, mass in zip(batch.names, batch.plans.xy, batch.plans.z, batch.plans.mass):
            mine = table[table["tower"] == name]
            assert (mine[["x", "y"]].to_numpy() == xy).all()
            assert (mine["mass"].to_numpy() == mass).all()
            assert np.allclose(mine["z"], z, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_labels_are_those_of_the_analytic_rule_in_the_analytic_world(tiny_run: Path, tmp_path: Path) -> None:
    table = pd.read_parquet(tiny_run / "plans.parquet")
    table[TOWER_COLUMNS].to_parquet(tmp_path / "plans.parquet")
    seen = {}
    for batch in read_towers(tmp_path / "plans.parquet"):
        seen |= dict(zip(batch.names, standing_prefixes(batch.plans)))
    assert len(seen) == 12
    for name, group in table.groupby("tower"):
        stood = seen[name].tolist()
        fell = stood.index(False) if False in stood else len(stood)
        expected = [1] * fell + [0] * (fell < len(stood)) + [None] * (len(stood) - fell - 1)
        assert [None if label is pd.NA else label for label in group["label"]] == expected


@pytest.mark.slow
def test_figures_are_figures_of_the_tables(smoke: tuple[Path, Result]) -> None:
    folder = smoke[0] / "figures"
    for name in ("regret", "accuracy"):
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    regret, drawn = pd.read_parquet(smoke[0] / "regret.parquet"), pd.read_csv(folder / "regret.csv")
    assert list(drawn.columns) == ["world", "task", "plans", "median", "q25", "q75", "runs", "problems"]
    assert len(drawn)
    for row in drawn.itertuples():
        mine = (regret["world"] == row.world) & (regret["task"] == row.task) & (regret["plans"] == row.plans)
        values = regret[mine]["regret"].dropna()
        assert np.allclose([row.q25, row.median, row.q75], np.percentile(values, [25, 50, 75]))
        assert (row.runs, row.problems) == (1, len(values))
    drawn = pd.read_csv(folder / "accuracy.csv")
    accuracy = pd.read_parquet(smoke[0] / "accuracy.parquet").sort_values(["length", "plans"])
    drawn = drawn.sort_values(["length", "plans"])
    measures = ["accuracy", "auc", "nll", "ece"]
    assert np.allclose(drawn[measures], accuracy[measures])


@pytest.mark.slow
def test_the_directory_is_enough_to_plan_with_its_model(smoke: tuple[Path, Result]) -> None:
    """From its config and weights alone, an evaluation comes out as the tables say."""
    directory, _ = smoke
    with initialize_config_dir(str(directory), version_base="1.3"):
        cfg = compose("config")
    config = validate(cfg)
    model = make_model(cfg, config)
    evaluator = Evaluator(config.evaluation, config.domain, config.planner, config.task)
    for step, towers in ((1, 30), (2, 40)):
        model.load(directory / "weights" / f"step_{step:04d}.safetensors")
        for name, again in (
            ("accuracy", evaluator.accuracy(model, step, towers)),
            ("regret", regret_table(evaluator.plan(model, step), step, towers)),
        ):
            table = pd.read_parquet(directory / f"{name}.parquet")
            table = table[table["step"] == step].reset_index(drop=True)
            pd.testing.assert_frame_equal(table, again, check_exact=True, check_dtype=False)


@pytest.mark.parametrize("sampler", ["sequential", "greedy", "incremental", "random_ss", "complete", "random_comp"])
def test_initial_towers(sampler: str, here: Path) -> None:
    """40 to train on and 40 to validate with: pairs for Theta_ss, 2 to 5 blocks for Theta_comp."""
    with initialize_config_dir(config_dir(), version_base="1.3"):
        cfg = compose("config", [f"sampler={sampler}"])
    config = validate(cfg)
    store = Store(here, config.domain)
    for split, n in (("train", config.initial.train), ("validation", config.initial.validation)):
        plans = config.sampler.start(config.domain, n, np.random.default_rng(0))
        lengths = [scored.plan.length for scored in plans]
        whole = config.sampler.kind is Kind.COMPLETE
        assert lengths == ([2] * 10 + [3] * 10 + [4] * 10 + [5] * 10 if whole else [2] * 40), split
    store.close()


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(("sampler", "trained"), [("sequential", [0, 1, 2]), ("random_ss", [2])])
def test_a_model_is_trained_only_to_be_asked(sampler: str, trained: list[int], here: Path) -> None:
    call(*TINY, f"sampler={sampler}", "evaluation.every=12", "hydra.run.dir=run").must_work()
    records = [json.loads(line) for line in (here / "run" / "journal.jsonl").read_text().splitlines()]
    assert [record["step"] for record in records if record["kind"] == "training"] == trained


@pytest.mark.usefixtures("no_figures")
def test_a_label_is_in_the_journal_before_the_next_tower_starts(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file, as anybody may read it, holds every label but those still to come."""
    seen = []
    execute = NoisyWorld.execute

    def looking(self: NoisyWorld, plans: object, rng: np.random.Generator) -> np.ndarray:
        if (here / "run").exists():
            rows = journal(here / "run")
            seen.append((len(rows), int(rows["labels"].notna().sum()) if "labels" in rows else 0))
        return execute(self, plans, rng)

    monkeypatch.setattr(NoisyWorld, "execute", looking)
    call(*TINY, "~world@evaluation.worlds.noisy", "hydra.run.dir=run").must_work()
    assert seen == [(8, n) for n in range(8)] + [(10, 8), (10, 9), (12, 10), (12, 11)]


@pytest.mark.usefixtures("no_figures")
def test_the_last_acquisition_is_cut_to_the_number_of_towers(here: Path) -> None:
    size = ("plans=25", "acquisition.plans=10", "acquisition.validation=2", "evaluation.every=20")
    call(*TINY, *size, "hydra.run.dir=run").must_work()
    rows = journal(here / "run")
    assert rows.groupby("step").size().tolist() == [8, 10, 7]
    assert rows.groupby("step")["split"].value_counts().unstack()["validation"].tolist() == [4, 2, 1]
    regret = pd.read_parquet(here / "run" / "regret.parquet")
    assert sorted(set(zip(regret["step"], regret["plans"]))) == [(2, 25)]
    assert [path.name for path in (here / "run" / "weights").iterdir()] == ["step_0002.safetensors"]


@pytest.mark.usefixtures("no_figures")
def test_the_last_step_is_evaluated_whatever_the_period(here: Path) -> None:
    call(*TINY, "plans=13", "evaluation.every=4").must_work()
    (path,) = here.rglob("accuracy.parquet")
    assert pd.read_parquet(path)["step"].tolist() == [2, 3]


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(("also", "steps"), [("[]", [2]), ("[8]", [0, 2]), ("[9]", [1, 2]), ("[8,10,12]", [0, 1, 2])])
def test_evaluations_come_where_one_asks_for_them_too(here: Path, also: str, steps: list[int]) -> None:
    call(*TINY, "evaluation.every=12", f"evaluation.also={also}").must_work()
    (path,) = here.rglob("accuracy.parquet")
    assert pd.read_parquet(path)["step"].tolist() == steps


@pytest.mark.usefixtures("no_figures")
def test_initial_towers_alone_are_a_run_too(here: Path) -> None:
    call(*TINY, "plans=8", "hydra.run.dir=run").must_work()
    assert set(pd.read_parquet(here / "run" / "plans.parquet")["step"]) == {0}
    regret = pd.read_parquet(here / "run" / "regret.parquet")
    assert set(zip(regret["step"], regret["plans"])) == {(0, 8)}
    assert (here / "run" / "weights" / "step_0000.safetensors").exists()


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("domain", ["towers", "packing"])
def test_a_run_that_plans_by_search_regrets_what_a_search_would_have_found(here: Path, domain: str) -> None:
    small = ("planner=search", "planner.start=20", "planner.generations=3", "planner.children=10")
    call(*TINY, f"domain={domain}", *small, "hydra.run.dir=run").must_work()
    regret = pd.read_parquet(here / "run" / "regret.parquet")
    reward = regret["value"] * regret["feasible"]
    assert (regret["search_value"] >= regret["best_value"]).all()
    assert ((regret["search_value"] - reward) / regret["search_value"] == regret["search_regret"]).all()
    assert regret["search_regret"].notna().all()
    chosen = pd.read_parquet(here / "run" / "evaluation_plans.parquet")
    assert len(chosen) == 2 * len(regret), "each plan has two placements"
    call("resume=run").must_work()


@pytest.mark.usefixtures("no_figures")
def test_a_subset_of_the_tasks(here: Path) -> None:
    call(*TINY, "task=[overhang]", "hydra.run.dir=run").must_work()
    assert set(pd.read_parquet(here / "run" / "regret.parquet")["task"]) == {"overhang"}


def test_problems_where_nothing_stands_have_no_regret(here: Path) -> None:
    """One candidate of five blocks: it hardly ever stands, so nothing can be normalised; the run still ends well."""
    call(*TINY, "planner.candidates=1", "evaluation.length=5", "evaluation.problems=2", "hydra.run.dir=run").must_work()
    regret = pd.read_parquet(here / "run" / "regret.parquet")
    assert (regret["best_value"] == 0).all()
    assert regret["regret"].isna().all()
    assert not regret["feasible"].any()


@pytest.mark.usefixtures("no_figures")
def test_nothing_to_evaluate(here: Path) -> None:
    call(*TINY, "evaluation.problems=0", "evaluation.test_plans=0", "hydra.run.dir=run").must_work()
    regret, accuracy = (pd.read_parquet(here / "run" / f"{name}.parquet") for name in ("regret", "accuracy"))
    assert (list(regret.columns), len(regret)) == (REGRET, 0)
    assert (list(accuracy.columns), len(accuracy)) == (ACCURACY, 0)
    assert len(pd.read_parquet(here / "run" / "plans.parquet"))


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("predictor", ["analytic", "simulation"])
def test_predictors_that_know_the_physics_are_evaluated_once(here: Path, predictor: str) -> None:
    overrides = (*TINY, f"predictor={predictor}", "evaluation.test_plans=40", "hydra.run.dir=run")
    call(*overrides).must_work()
    regret, accuracy, towers = (
        pd.read_parquet(here / "run" / f"{name}.parquet") for name in ("regret", "accuracy", "plans")
    )
    assert set(regret["step"]) == set(accuracy["step"]) == {0}
    assert set(regret["plans"]) == {0}
    assert regret["task"].tolist() == [task for task in TASKS for _ in WORLDS]
    if predictor == "analytic":
        assert (regret[regret["world"] == "analytic"]["regret"] == 0).all()
        assert (accuracy["accuracy"] == 1).all()
    assert len(towers) == 0
    assert list(towers.columns) == PLACEMENTS, "column names are fixed, also where no tower was labelled"
    assert not list((here / "run" / "weights").iterdir())
    assert "finished" in call(*overrides).must_work().err
