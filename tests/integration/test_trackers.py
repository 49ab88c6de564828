"""TensorBoard, MLflow and the table of metrics: mirrors of a run, several at once."""

import os
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml
from mlflow import MlflowClient
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from apf.tracking import CsvTracker, Metrics, MlflowTracker, Phase, RunFiles, RunInfo, TensorBoardTracker, Tracker
from integration.command_line import TINY, call

HISTORY = (
    Metrics(0, Phase.EXECUTED, 8, {"data/feasible_share": 0.5}),
    Metrics(0, Phase.LEARNED, 8, {"loss/train": 0.25}),
    Metrics(1, Phase.EXECUTED, 10, {"data/feasible_share": 0.75}),
)
LAST = Metrics(1, Phase.LEARNED, 10, {"loss/train": 0.125})
POINTS = {"data/feasible_share": [(8, 0.5), (10, 0.75)], "loss/train": [(8, 0.25), (10, 0.125)]}
"""What the history and the last metrics are together."""
MIRRORS = {"tensorboard": TensorBoardTracker, "mlflow": MlflowTracker, "csv": CsvTracker}


@pytest.fixture(autouse=True)
def bare_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("MLFLOW_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")


def info(history: tuple[Metrics, ...], directory: Path = Path("run")) -> RunInfo:
    directory.mkdir(exist_ok=True)
    config = {"seed": 0, "training": {"batch": 64}}
    return RunInfo("mine", "abc", directory, config, None, history, {"sampler": "greedy"}, {"host": "here"})


def points_in_tensorboard(directory: Path) -> dict[str, list[tuple[int, float]]]:
    events = EventAccumulator(str(directory / "tensorboard"))
    events.Reload()
    return {tag: [(e.step, e.value) for e in events.Scalars(tag)] for tag in events.Tags()["scalars"]}


def points_in_mlflow(folder: Path) -> dict[str, list[tuple[int, float]]]:
    client = MlflowClient(folder.absolute().as_uri())
    (run,) = client.search_runs([client.get_experiment_by_name("apf").experiment_id])
    histories = {name: client.get_metric_history(run.info.run_id, name) for name in run.data.metrics}
    return {name: [(point.step, point.value) for point in points] for name, points in histories.items()}


def points_in_csv(directory: Path) -> dict[str, list[tuple[int, float]]]:
    table = pd.read_csv(directory / "metrics.csv")
    assert table["step"].is_unique
    return {name: [*zip(table["plans"], table[name])] for name in table.columns[2:]}


def points(name: str) -> dict[str, list[tuple[int, float]]]:
    if name == "mlflow":
        return points_in_mlflow(Path("mlruns"))
    return (points_in_tensorboard if name == "tensorboard" else points_in_csv)(Path("run"))


@pytest.mark.parametrize("name", MIRRORS)
def test_each_point_is_there_once_however_often_a_run_is_resumed(here: Path, name: str) -> None:
    for history, then in (((), HISTORY), (HISTORY[:2], HISTORY[2:]), (HISTORY, (LAST,))):
        tracker: Tracker = MIRRORS[name]()
        tracker.start(info(history))
        for metrics in (*then, *then[-1:]):
            tracker.log(metrics)
        tracker.finish(failed=False)
    assert points(name) == POINTS


def test_mlflow_holds_config_words_and_files(here: Path) -> None:
    tracker = MlflowTracker()
    tracker.start(info(HISTORY))
    (here / "table.csv").write_text("a\n")
    tracker.keep(RunFiles(10, [here / "table.csv"], [], lambda: {"curves/x": here / "table.csv"}))
    tracker.finish(failed=True)
    client = MlflowClient((here / "mlruns").as_uri())
    (run,) = client.search_runs([client.get_experiment_by_name("apf").experiment_id])
    assert run.data.params == {"host": "here", "seed": "0", "training.batch": "64"}
    assert (run.info.run_name, run.info.status) == ("mine", "FAILED")
    assert (run.data.tags["sampler"], run.data.tags["apf.id"]) == ("greedy", "abc")
    assert {file.path for file in client.list_artifacts(run.info.run_id)} == {"table.csv", "pictures"}


@pytest.mark.parametrize(("name", "module"), [("tensorboard", "torch.utils.tensorboard"), ("mlflow", "mlflow")])
def test_without_the_extra(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    if name == "tensorboard":
        monkeypatch.delitem(sys.modules, module, raising=False)
    else:
        monkeypatch.setitem(sys.modules, module, None)
    tracker = MIRRORS[name]()
    tracker.start(info(HISTORY))
    tracker.log(LAST)
    tracker.finish(failed=False)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"pip install 'apf[{name}]'")


def test_several_at_once(here: Path) -> None:
    trackers = "tracker=[csv,tensorboard,mlflow]"
    call(*TINY, trackers, "hydra.run.dir=run").must_work()
    found = {name: points(name) for name in MIRRORS}
    assert set(found["csv"]) == set(found["tensorboard"]) == set(found["mlflow"]) > {"loss/train", "accuracy/2"}
    assert yaml.safe_load(Path("run/run.yaml").read_text())["choices"]["tracker"] == ["csv", "tensorboard", "mlflow"]
    call("resume=run", "plans=14").must_work()
    assert len(points_in_csv(Path("run"))["loss/train"]) == 4
    for name in MIRRORS:
        assert [step for step, _ in points(name)["loss/train"]] == [8, 10, 12, 14]
    call("resume=run", "plans=16", "tracker=none").must_work()
    assert len(points_in_csv(Path("run"))["loss/train"]) == 4, "the table is of the trackers that were chosen"


def test_a_tracker_alone_as_in_a_config_of_an_earlier_version(here: Path) -> None:
    call(*TINY, "hydra.run.dir=run").must_work()
    config = yaml.safe_load(Path("run/config.yaml").read_text())
    config["tracker"] = {"_target_": "apf.tracking.CsvTracker"}
    Path("run/config.yaml").write_text(yaml.safe_dump(config))
    call("resume=run", "plans=14").must_work()
    assert len(points_in_csv(Path("run"))["loss/train"]) == 4
