"""Weights & Biases (W&B). If W&B fails, the run loses this mirror and goes on."""

import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from apf.config.values import flatten
from apf.settings import Seconds, Switch, settings
from apf.tracking.base import Metrics, Phase, RunFiles, RunInfo
from apf.tracking.mirror import Mirror

Mode = Literal["offline", "online"]
MODES: dict[str, Mode | None] = {
    **dict.fromkeys(("online", "run"), "online"),
    **dict.fromkeys(("offline", "dryrun"), "offline"),
    "disabled": None,
}
"""The values of W&B's variable WANDB_MODE, older names included, and the mode that each means; None: no mirror."""

TAGGED = ("domain", "sampler", "model", "world", "predictor", "planner")
"""Config groups whose chosen options are tags."""
LONGEST_TAG = 64
"""Characters that W&B allows in a tag."""


def mode_here(chosen: Mode, environment: Mapping[str, str]) -> Mode | None:
    """W&B's mode: the one of the environment variables, if they are set, else the chosen one.

    Returns None where WANDB_MODE or WANDB_DISABLED switches W&B off. Raises ValueError if WANDB_MODE is no mode.
    """
    if environment.get("WANDB_DISABLED", "").lower() not in ("", "0", "false", "no", "off"):
        return None
    named = environment.get("WANDB_MODE", "").lower() or chosen
    if named not in MODES:
        raise ValueError(f"WANDB_MODE is {named!r}; it should be online, offline or disabled")
    return MODES[named]


def job_type(choices: Mapping[str, str]) -> str:
    """What a run does: it learns, or it evaluates a predictor."""
    return "learn" if choices.get("predictor", "learned") == "learned" else "evaluate"


def tags(choices: Mapping[str, str]) -> list[str]:
    """The words by which runs are found: what they chose."""
    words = [choices[group] for group in TAGGED if group in choices and len(choices[group]) <= LONGEST_TAG]
    return list(dict.fromkeys(words))


def words_and_values(run: RunInfo) -> dict[str, Any]:
    """The config of a W&B run: choices as words, values by their dotted keys, commit, host, CPU and GPU."""
    values = {key: value for key, value in flatten(run.config).items() if not key.endswith(("_target_", "_partial_"))}
    words = {key: word for key, word in run.choices.items() if "/" not in key}
    return {**words, **{f"run.{key}": value for key, value in run.about.items()}, **values}


@settings
class WandbTracker(Mirror):
    """One W&B run per job. `offline` needs no account and no network: `wandb sync` sends the run later.

    A resumed run logs its whole history again, and each phase of a step has its own number. W&B skips the numbers that
    it has, so one W&B run holds the whole history. Offline, the files of earlier starts are then redundant, and are
    removed.

    W&B's environment variables win over the config, except for those that identify the run: only a run that
    `wandb agent` starts is the run that the agent made.

    The W&B run's config has the chosen options as words (`sampler: greedy`), and each value by its dotted key
    (`training.batch: 64`), as one types them. Its tags are words, too.
    """

    project: str | None
    mode: Mode
    timeout: Seconds
    """Seconds that a run waits for W&B's servers: when it starts, and for the last metrics when it ends."""
    entity: str | None = None
    artifacts: Switch = True
    """Keep the tables and the last weights as artifacts, and show pictures."""

    title = "W&B"

    def open_run(self, run: RunInfo) -> Any:
        """W&B's run; its files lie in the run directory, or in WANDB_DIR. Raises anything, on W&B's import too."""
        mode = mode_here(self.mode, os.environ)
        if self.mode == "online" != mode:
            print(f"tracker.wandb.mode is online, but W&B is {mode or 'disabled'} in this environment", file=sys.stderr)
        return None if mode is None else self._opened(run, mode)

    def _opened(self, run: RunInfo, mode: Mode) -> Any:
        directory = Path(os.environ.get("WANDB_DIR") or run.directory)
        identifier = (os.environ.get("WANDB_RUN_ID") if os.environ.get("WANDB_SWEEP_ID") else None) or run.id
        if mode == "offline":
            for folder in (directory / "wandb").glob(f"offline-run-*-{identifier}"):
                shutil.rmtree(folder, ignore_errors=True)
        directory.mkdir(parents=True, exist_ok=True)  # W&B would take a temporary one
        os.environ.setdefault("WANDB_ERROR_REPORTING", "false")  # no reports of W&B's own errors
        os.environ.setdefault("WANDB_DATA_DIR", str(directory / "wandb"))  # where artifacts wait to be sent
        os.environ.setdefault("WANDB_SILENT", "true")  # nothing printed, and no question of who is there
        import wandb

        seconds = self.timeout
        own = {"console": "off", "init_timeout": seconds, "login_timeout": seconds, "finish_timeout": seconds}
        own = {name: value for name, value in own.items() if f"WANDB_{name.upper()}" not in os.environ}
        opened = wandb.init(
            project=self.project,
            entity=self.entity,
            mode=mode,
            name=run.name,
            id=identifier,
            resume="allow" if mode == "online" else None,
            group=run.group,
            job_type=job_type(run.choices),
            tags=tags(run.choices),
            dir=directory,
            config=words_and_values(run),
            reinit="create_new",  # whatever became of the run of another job of this process
            settings=wandb.Settings(**own, finish_timeout_raises=True),
        )
        opened.define_metric("plans")
        opened.define_metric("*", step_metric="plans")
        return opened

    def write(self, opened: Any, metrics: Metrics) -> None:
        """Curves over the number of labelled plans."""
        numbers = {name: float(value) for name, value in metrics.values.items()}
        row = {"plans": metrics.plans, "step": metrics.step, **numbers}
        opened.log(row, step=metrics.step * len(Phase) + metrics.phase)

    def write_files(self, opened: Any, files: RunFiles) -> None:
        """Pictures, and the run's tables and weights as artifacts."""
        if not self.artifacts:
            return
        import wandb

        pictures = {name: wandb.Image(str(path)) for name, path in files.pictures().items()}
        if pictures:
            opened.log({"plans": files.plans, **pictures})
        for kind, paths in (("tables", files.tables), ("model", files.weights)):
            artifact = wandb.Artifact(f"{kind}-{opened.id}", type=kind)
            for path in paths:
                artifact.add_file(str(path))
            if paths:
                opened.log_artifact(artifact)

    def close(self, opened: Any, failed: bool) -> None:
        """Close the run."""
        opened.finish(exit_code=int(failed))
