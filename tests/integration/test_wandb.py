"""W&B is a mirror: offline by default, one run per job, finished each time, whatever happens."""

import json
import os
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import pandas as pd
import pytest
import wandb
import wandb.errors
import yaml

from apf.experiment import Experiment
from apf.rundir.store import Store
from apf.tracking.weights_and_biases import job_type, mode_here, tags
from integration.command_line import TINY, call, spawn


@pytest.fixture(autouse=True)
def clean(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """No settings or logins of whoever runs the tests."""
    for name in [name for name in os.environ if name.startswith("WANDB_")]:
        monkeypatch.delenv(name)
    home = tmp_path_factory.mktemp("home")
    for name in ("HOME", "WANDB_CONFIG_DIR", "WANDB_CACHE_DIR", "WANDB_DATA_DIR"):
        monkeypatch.setenv(name, str(home))


class FakeRun:
    """Notes what a W&B run would be told."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = settings
        self.id = settings["id"]
        self.media: list[dict[str, Any]] = []
        self.artifacts: list[Any] = []
        self.metrics: list[tuple[str, str | None]] = []
        self.logged: list[dict[str, float]] = []
        self.numbers: list[int] = []
        self.finished: list[int] = []

    def define_metric(self, name: str, step_metric: str | None = None) -> None:
        self.metrics.append((name, step_metric))

    def log(self, figures: dict[str, float], step: int | None = None) -> None:
        assert not self.finished, "logged after the end"
        if step is None:
            self.media.append(figures)
            return
        assert step not in self.numbers, "two rows under one number"
        self.numbers.append(step)
        self.logged.append(figures)

    def log_artifact(self, artifact: Any) -> None:
        self.artifacts.append(artifact)

    def finish(self, exit_code: int) -> None:
        self.finished.append(exit_code)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> list[FakeRun]:
    """The runs that were opened, in place of real ones."""
    opened: list[FakeRun] = []

    def init(**settings: Any) -> FakeRun:
        assert all(run.finished for run in opened), "one run is still open"
        opened.append(FakeRun(settings))
        return opened[-1]

    monkeypatch.setattr(wandb, "init", init)
    return opened


@pytest.fixture
def listener() -> Iterator[tuple[str, list[Any]]]:
    """An address that refuses everybody, and who came."""
    came: list[Any] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def listen() -> None:
            with suppress(OSError):
                while True:
                    connection, address = server.accept()
                    came.append(address)
                    connection.close()

        threading.Thread(target=listen, daemon=True).start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", came


@pytest.mark.slow
def test_offline_without_any_network(tmp_path: Path, listener: tuple[str, list[Any]]) -> None:
    """All that W&B could reach is an address where nobody may come."""
    url, came = listener
    overrides = [*TINY, "tracker=wandb", "hydra.run.dir=run"]
    environment = dict.fromkeys(["HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy", "WANDB_BASE_URL"], url)
    result = spawn(["-m", "apf.main", *overrides], cwd=tmp_path, **environment, HOME=str(tmp_path)).must_work()
    assert came == []
    (mirror,) = (tmp_path / "run" / "wandb").glob("offline-run-*")
    (record,) = mirror.glob("run-*.wandb")
    assert record.stat().st_size > 0
    assert not (tmp_path / "wandb").exists(), "its files lie in the run directory"
    assert "wandb:" not in result.out + result.err
    with suppress(OSError), urllib.request.urlopen(url):
        pass
    assert len(came) == 1, "the address does notice a visitor"


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_jobs_of_a_sweep_are_runs_of_their_own(here: Path) -> None:
    call("-m", *TINY, "hydra/launcher=basic", "tracker=wandb", "seed=0,1", "sweep=mine").must_work()
    runs = [path for path in (here / "runs" / "mine").iterdir() if path.is_dir()]
    assert len(runs) == 2
    records = [record.name for run in runs for record in run.glob("wandb/offline-run-*/run-*.wandb")]
    assert len(records) == 2
    assert len(set(records)) == 2
    assert wandb.run is None


@pytest.mark.usefixtures("no_figures")
def test_what_is_told(here: Path, fakes: list[FakeRun]) -> None:
    call(
        *TINY, "tracker=wandb", "tracker.wandb.project=mine", "tracker.wandb.entity=us", "hydra.run.dir=run"
    ).must_work()
    (run,) = fakes
    assert (run.settings["mode"], run.settings["project"], run.settings["entity"]) == ("offline", "mine", "us")
    assert run.settings["name"] == "run"
    assert run.settings["group"] is None
    assert Path(run.settings["dir"]).resolve() == here / "run"
    config = yaml.safe_load((here / "run" / "config.yaml").read_text())
    told_config = run.settings["config"]
    assert {key: told_config[key] for key in ("sampler", "model", "world", "domain")} == {
        "sampler": "sequential",
        "model": "tgn",
        "world": "noisy",
        "domain": "towers",
    }
    assert told_config["task"] == "tallest+overhang+unsupported"
    assert told_config["training.batch"] == config["training"]["batch"]
    assert {"run.commit", "run.host", "run.cpu"} <= set(told_config)
    assert not any("_target_" in key for key in told_config)
    assert run.settings["job_type"] == "learn"
    assert run.settings["tags"] == ["towers", "sequential", "tgn", "noisy", "learned", "monte_carlo"]
    (media,) = run.media
    assert {"chosen/tallest", "chosen/overhang", "chosen/unsupported"} <= set(media)
    tables, model = run.artifacts
    assert {"plans.parquet", "regret.parquet"} <= set(tables.manifest.entries)
    assert set(model.manifest.entries) == {"step_0002.safetensors"}
    assert run.metrics == [("plans", None), ("*", "plans")]
    assert run.finished == [0]
    told = {}
    for figures in run.logged:
        assert figures["plans"] == {0: 8, 1: 10, 2: 12}[figures["step"]]
        told.setdefault(figures["step"], {}).update(figures)
    assert set(told) == {0, 1, 2}
    regret, accuracy = (pd.read_parquet(here / "run" / f"{name}.parquet") for name in ("regret", "accuracy"))
    for step in (1, 2):
        figures = told[step]
        for world, task in product(("analytic", "noisy"), ("tallest", "overhang", "unsupported")):
            mine = regret[(regret["step"] == step) & (regret["task"] == task) & (regret["world"] == world)]
            assert figures[f"regret/{world}/{task}"] == pytest.approx(mine["regret"].median(), nan_ok=True)
            assert figures[f"success/{world}/{task}"] == mine["feasible"].mean()
        assert figures["accuracy/2"] == accuracy[accuracy["step"] == step]["accuracy"].item()
    for figures in told.values():
        assert {"loss/train", "data/feasible_share"} <= set(figures)
    assert "score/mean" not in told[0]
    assert not any(name.startswith("regret") for name in told[0])
    towers = pd.read_parquet(here / "run" / "plans.parquet").query("step == 1").groupby("tower")
    assert told[1]["score/mean"] == pytest.approx(towers["score"].first().mean())
    share = (towers["label"].min().fillna(0) == 1).mean()
    assert told[1]["data/feasible_share"] == share


@pytest.mark.usefixtures("no_figures")
def test_jobs_of_a_sweep_are_grouped(here: Path, fakes: list[FakeRun]) -> None:
    call("-m", *TINY, "hydra/launcher=basic", "tracker=wandb", "seed=0,1", "sweep=mine").must_work()
    assert [run.settings["group"] for run in fakes] == ["mine", "mine"]
    assert [run.settings["config"]["seed"] for run in fakes] == [0, 1]
    names = {path.name for path in (here / "runs" / "mine").iterdir() if path.is_dir()}
    assert {run.settings["name"] for run in fakes} == names
    assert len(names) == 2
    assert [run.finished for run in fakes] == [[0], [0]]


@pytest.mark.usefixtures("no_figures")
def test_online_is_passed_on(here: Path, fakes: list[FakeRun]) -> None:
    call(*TINY, "tracker=wandb", "tracker.wandb.mode=online", "hydra.run.dir=run").must_work()
    assert [run.settings["mode"] for run in fakes] == ["online"]


def test_finished_also_when_the_run_fails(here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(self: Experiment, step: int) -> None:
        raise RuntimeError("the power is out")

    monkeypatch.setattr(Experiment, "learn", failing)
    result = call(*TINY, "tracker=wandb", "hydra.run.dir=run")
    assert result.code != 0
    assert "the power is out" in result.err
    assert [run.finished for run in fakes] == [[1]]
    assert yaml.safe_load((here / "run" / "run.yaml").read_text())["finished"] is False


def test_finished_also_when_interrupted(here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(self: Experiment, step: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Experiment, "learn", interrupted)
    result = call(*TINY, "tracker=wandb", "hydra.run.dir=run")
    assert result.code != 0
    assert "Traceback" not in result.err
    assert [run.finished for run in fakes] == [[1]]


@pytest.mark.usefixtures("no_figures")
def test_a_finished_run_opens_no_other(here: Path, fakes: list[FakeRun]) -> None:
    command = (*TINY, "tracker=wandb", "hydra.run.dir=run")
    call(*command).must_work()
    call(*command).must_work()
    assert len(fakes) == 1


def test_none_is_silent(here: Path, fakes: list[FakeRun]) -> None:
    call(*TINY, "tracker=none", "hydra.run.dir=run").must_work()
    assert fakes == []
    assert not list(here.rglob("wandb"))


def interrupt_after(labels: int, monkeypatch: pytest.MonkeyPatch) -> None:
    record, count = Store.record, iter(range(1, 1000))

    def recording(self: Store, *arguments: Any) -> None:
        record(self, *arguments)
        if next(count) == labels:
            raise KeyboardInterrupt

    monkeypatch.setattr(Store, "record", recording)


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("mode", ["offline", "online"])
def test_a_resumed_run_is_one_run_with_its_whole_history(
    here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    command = (*TINY, "tracker=wandb", f"tracker.wandb.mode={mode}")
    call(*command, "hydra.run.dir=whole").must_work()
    with monkeypatch.context() as patch:
        interrupt_after(10, patch)
        assert call(*command, "hydra.run.dir=run").code == 130
    call("resume=run").must_work()
    whole, first, second = fakes
    assert first.settings["id"] == second.settings["id"] != whole.settings["id"]
    assert second.settings["resume"] == ("allow" if mode == "online" else None)
    assert second.numbers == whole.numbers
    assert second.logged == whole.logged
    assert first.logged == whole.logged[: len(first.logged)]


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_offline_files_after_a_resume_are_those_of_one_run(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        interrupt_after(10, patch)
        assert call(*TINY, "tracker=wandb", "hydra.run.dir=run").code == 130
    call("resume=run").must_work()
    identifier = yaml.safe_load((here / "run" / "run.yaml").read_text())["id"]
    (record,) = (here / "run" / "wandb").glob("offline-run-*/run-*.wandb")
    assert record.name == f"run-{identifier}.wandb"
    text = record.read_bytes()
    for name in (b"data/feasible_share", b"loss/train"):
        assert text.count(name) >= 3, "steps 0, 1 and 2"
    assert text.count(b"regret/analytic/tallest") >= 2


@pytest.mark.usefixtures("no_figures")
def test_after_a_correction_it_is_another_run(here: Path, fakes: list[FakeRun]) -> None:
    """What was shown of the old label cannot be taken back there."""
    call(*TINY, "tracker=wandb", "hydra.run.dir=run").must_work()
    stood = pd.read_parquet(here / "run" / "plans.parquet")["label"].iloc[1] == 1
    call("run=run", "plan=0", f"labels={'10' if stood else '11'}", command="apf.relabel").must_work()
    call("resume=run").must_work()
    first, second = fakes
    assert second.settings["id"] == f"{first.settings['id']}-1"
    assert {figures["step"] for figures in second.logged} == {0, 1, 2}


@pytest.mark.usefixtures("no_figures")
def test_failing_in_the_middle_costs_the_mirror_only(
    here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = FakeRun.log

    def failing(self: FakeRun, figures: dict[str, float], step: int) -> None:
        if step > 1:
            raise OSError("the network is down")
        log(self, figures, step)

    monkeypatch.setattr(FakeRun, "log", failing)
    result = call(*TINY, "tracker=wandb", "hydra.run.dir=run").must_work()
    assert result.err.count("going on without it: the network is down") == 1
    assert len(fakes[0].logged) == 2


def goes_on_without(*arguments: str) -> str:
    """What the one line of a run says that goes on without W&B; the run must finish."""
    result = call(*TINY, "tracker=wandb", *arguments, "hydra.run.dir=run").must_work()
    (line,) = [line for line in result.err.splitlines() if line.startswith("W&B")]
    assert "Traceback" not in result.err
    assert yaml.safe_load(Path("run", "run.yaml").read_text())["finished"]
    return line.removeprefix("W&B does not work, going on without it: ")


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(
    "error",
    [
        wandb.errors.CommError("Run initialization has timed out"),
        wandb.errors.UsageError("api_key not configured (no-tty)\ncall wandb.login()"),
        wandb.errors.AuthenticationError("The API key is invalid"),
        OSError("the disk is gone"),
        SystemExit("the service left"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_failing_at_the_start_costs_the_mirror_only(
    here: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def failing(**settings: Any) -> None:
        raise error

    monkeypatch.setattr(wandb, "init", failing)
    assert goes_on_without("tracker.wandb.mode=online") == str(error).splitlines()[0]


@pytest.mark.usefixtures("no_figures")
def test_online_without_a_login(here: Path) -> None:
    """With the real library, at the start of a run."""
    assert "No API key configured" in goes_on_without("tracker.wandb.mode=online")


@pytest.mark.usefixtures("no_figures")
def test_a_resume_without_a_login(here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch) -> None:
    """The first start was fine; labels exist."""

    def failing(**settings: Any) -> None:
        raise wandb.errors.UsageError("No API key configured")

    with monkeypatch.context() as patch:
        interrupt_after(10, patch)
        assert call(*TINY, "tracker=wandb", "tracker.wandb.mode=online", "hydra.run.dir=run").code == 130
    monkeypatch.setattr(wandb, "init", failing)
    result = call("resume=run").must_work()
    assert result.err.count("W&B does not work, going on without it: No API key configured") == 1
    assert len(pd.read_parquet("run/plans.parquet")["tower"].unique()) == 12


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("module", [None, ModuleType("wandb")], ids=["missing", "broken"])
def test_without_the_library(here: Path, monkeypatch: pytest.MonkeyPatch, module: ModuleType | None) -> None:
    """wandb is not there, or what is imported by that name is a folder that an earlier run left."""
    monkeypatch.setitem(sys.modules, "wandb", module)  # type: ignore[arg-type]
    assert "wandb" in goes_on_without()


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("module", [None, ModuleType("wandb")], ids=["missing", "broken"])
def test_a_resume_without_the_library(here: Path, monkeypatch: pytest.MonkeyPatch, module: ModuleType | None) -> None:
    with monkeypatch.context() as patch:
        interrupt_after(10, patch)
        assert call(*TINY, "tracker=wandb", "tracker.wandb.mode=offline", "hydra.run.dir=run").code == 130
    monkeypatch.setitem(sys.modules, "wandb", module)  # type: ignore[arg-type]
    assert call("resume=run").must_work().err.count("W&B does not work, going on without it: ") == 1


class Server(ThreadingHTTPServer):
    """As much of W&B's server as a run needs to open; then it may fail, or never answer again."""

    daemon_threads = True
    bucket: ClassVar = {
        **dict.fromkeys(("id", "name", "displayName"), "x"),
        "project": {"id": "1", "name": "apf", "entity": {"id": "1", "name": "us"}},
    }

    def __init__(self, how: str) -> None:
        self.how, self.opened = how, False
        super().__init__(("127.0.0.1", 0), Answer)


class Answer(BaseHTTPRequestHandler):
    """One request."""

    server: Server
    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        said = self.rfile.read(int(self.headers.get("Content-Length", 0))).decode(errors="replace")
        works = self.server.how.startswith("later") and not self.server.opened
        if not works and self.server.how.endswith("silent"):
            time.sleep(60)
        self.server.opened |= "upsertBucket" in said
        answer = {"upsertBucket": {"bucket": self.server.bucket, "inserted": True}} if "upsertBucket" in said else {}
        body = json.dumps({"data": {"viewer": {"id": "1", "entity": "us"}, "model": None, **answer}}).encode()
        self.send_response(200 if works else 500)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_GET = do_PUT = do_POST

    def log_message(self, *arguments: Any) -> None:
        """Say nothing."""


@pytest.mark.slow
@pytest.mark.parametrize("how", ["failing", "silent", "later failing", "later silent"])
def test_a_server_that_fails_or_never_answers(tmp_path: Path, how: str) -> None:
    """With the real library: an error from the beginning, no answer at all, and both after the run has opened."""
    with Server(how) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        overrides = [
            *TINY,
            "tracker=wandb",
            "tracker.wandb.mode=online",
            "tracker.wandb.timeout=2",
            "hydra.run.dir=run",
        ]
        begun = time.monotonic()
        result = spawn(
            ["-m", "apf.main", *overrides],
            cwd=tmp_path,
            WANDB_BASE_URL=f"http://127.0.0.1:{server.server_port}",
            WANDB_API_KEY="a" * 40,
        ).must_work()
        server.shutdown()
    assert time.monotonic() - begun < 50
    assert server.opened is how.startswith("later")
    assert result.err.count("W&B does not work, going on without it: ") == 1, result.err
    assert "Traceback" not in result.err
    assert yaml.safe_load((tmp_path / "run" / "run.yaml").read_text())["finished"]


@pytest.mark.parametrize(
    ("chosen", "environment", "mode"),
    [
        ("offline", {}, "offline"),
        ("online", {}, "online"),
        ("online", {"WANDB_MODE": ""}, "online"),
        ("online", {"WANDB_MODE": "offline"}, "offline"),
        ("online", {"WANDB_MODE": "dryrun"}, "offline"),
        ("offline", {"WANDB_MODE": "online"}, "online"),
        ("offline", {"WANDB_MODE": "run"}, "online"),
        ("online", {"WANDB_MODE": "disabled"}, None),
        ("online", {"WANDB_DISABLED": "true"}, None),
        ("online", {"WANDB_DISABLED": "1", "WANDB_MODE": "online"}, None),
        ("online", {"WANDB_DISABLED": "false"}, "online"),
    ],
)
def test_the_mode_of_the_environment_wins(chosen: Any, environment: dict[str, str], mode: str | None) -> None:
    assert mode_here(chosen, environment) == mode


@pytest.mark.usefixtures("no_figures")
def test_environment_variables(here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of W&B hold, but a run remains itself."""
    variables = {
        "MODE": "offline",
        "DIR": str(here / "elsewhere"),
        "PROJECT": "theirs",
        "ENTITY": "them",
        "CONSOLE": "redirect",
        "RUN_ID": "always-the-same",
    }
    for name, value in variables.items():
        monkeypatch.setenv(f"WANDB_{name}", value)
    result = call(*TINY, "tracker=wandb", "tracker.wandb.mode=online", "hydra.run.dir=run").must_work()
    assert "tracker.wandb.mode is online, but W&B is offline in this environment" in result.err
    call(*TINY, "tracker=wandb", "tracker.wandb.project=mine", "seed=1", "hydra.run.dir=other").must_work()
    (first, second) = fakes
    assert first.settings["mode"] == "offline"
    assert Path(first.settings["dir"]) == here / "elsewhere"
    assert (first.settings["project"], first.settings["entity"]) == ("theirs", "them")
    assert second.settings["project"] == "mine", "what the command says wins over the environment"
    assert first.settings["settings"].console == wandb.Settings().console, "WANDB_CONSOLE is left to W&B"
    assert first.settings["settings"].init_timeout == 30
    assert {run.settings["id"] for run in fakes} == {
        yaml.safe_load((here / name / "run.yaml").read_text())["id"] for name in ("run", "other")
    }


@pytest.mark.usefixtures("no_figures")
def test_a_run_of_an_agent_is_the_run_that_the_agent_made(
    here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WANDB_SWEEP_ID", "swept")
    monkeypatch.setenv("WANDB_RUN_ID", "made")
    call(*TINY, "tracker=wandb", "tracker.wandb.artifacts=false", "hydra.run.dir=run").must_work()
    (run,) = fakes
    assert run.settings["id"] == "made"
    assert (run.media, run.artifacts) == ([], [])


def test_words() -> None:
    choices = {
        "domain": "towers",
        "sampler": "greedy",
        "model": "m" * 65,
        "predictor": "simulation",
        "world/noisy": "x",
    }
    assert tags(choices) == ["towers", "greedy", "simulation"], "W&B takes no longer ones"
    assert [job_type(each) for each in (choices, {"predictor": "learned"}, {})] == ["evaluate", "learn", "learn"]


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("variable", ["WANDB_MODE=disabled", "WANDB_DISABLED=true"])
def test_switched_off_by_the_environment(
    here: Path, fakes: list[FakeRun], monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    monkeypatch.setenv(*variable.split("="))
    result = call(*TINY, "tracker=wandb", "hydra.run.dir=run").must_work()
    assert fakes == []
    assert "W&B" not in result.err


@pytest.mark.usefixtures("no_figures")
def test_a_mode_that_does_not_exist(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "onlin")
    assert goes_on_without() == "WANDB_MODE is 'onlin'; it should be online, offline or disabled"


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_wandb_dir_offline(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the real library, which also replaces the files of an earlier start there."""
    monkeypatch.setenv("WANDB_DIR", "elsewhere")
    with monkeypatch.context() as patch:
        interrupt_after(10, patch)
        assert call(*TINY, "tracker=wandb", "hydra.run.dir=run").code == 130
    call("resume=run").must_work()
    assert len(list((here / "elsewhere" / "wandb").glob("offline-run-*"))) == 1
    assert not (here / "run" / "wandb").exists()
