"""A sweep: finds which of its runs are missing, starts each in a process of its own, and says what came of each."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf, open_dict
from rich.console import Console

from apf.cli import FOLLOWER, MISTAKES, one_line
from apf.config import Config, build, check_hydra, check_parts, name_of, plain, with_values
from apf.errors import InputError, Stopped
from apf.interrupts import Interrupted
from apf.rundir import check, finished, hydra_arguments, quoted

PATIENCE = 20.0
"""Seconds that a run has to end after SIGTERM."""
AGAIN = "the same command again does what is missing"


@dataclass
class Job:
    """One run of a sweep. state: empty until it is known what came of it. reason: of a failure."""

    overrides: list[str]
    directory: Path
    command: list[str]
    threads: int
    state: str = ""
    reason: str = ""

    @property
    def failed(self) -> bool:
        """Did it not finish?"""
        return self.state not in ("finished", "already finished")


class Sweep:
    """All runs of one sweep command."""

    def __init__(self, context: HydraContext, config: DictConfig, jobs: int | str, engine: Launcher | None) -> None:
        """jobs: runs at once, or `auto`; for the engine, if there is one, it means nothing."""
        if engine is None and jobs != "auto" and (not isinstance(jobs, int) or jobs < 1):
            raise InputError(f"hydra.launcher.jobs is {jobs!r}; it must be auto or a positive number")
        self.context, self.config, self.jobs, self.engine = context, config, jobs, engine
        self.directory = Path(config.hydra.sweep.dir).absolute()
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.processes: list[subprocess.Popen] = []
        self.checked: dict[int, DictConfig] = {}
        """By their ids, configs in which Hydra's own part is right."""
        self.built: dict[str, Config] = {}
        """By the settings that they were made of: parts, which the jobs that have them share."""
        self.over = False

    def run(self, job_overrides: Sequence[Sequence[str]], first: int) -> list[JobReturn]:
        """Do what is missing, and tell what came of it. Raises Stopped if a run did not finish."""
        jobs: dict[Path, Job] = {}
        for number, overrides in enumerate(job_overrides, first):
            job = self.prepare(list(overrides), number)
            jobs.setdefault(job.directory, job)  # what differs in nothing that matters is one run
        missing = [job for job in jobs.values() if not job.state]
        try:
            if missing and self.engine is None:
                self.run_locally(missing, len(jobs))
            elif missing and self.engine is not None:
                self.run_elsewhere(self.engine, missing, len(jobs), first)
        except KeyboardInterrupt as error:
            raise Interrupted(getattr(error, "number", 2), f"interrupted; {AGAIN}") from None
        finally:
            self.summarise(list(jobs.values()))
        failed = sum(job.failed for job in jobs.values())
        if failed:
            raise Stopped(f"{failed} of {len(jobs)} runs did not finish; {AGAIN}")
        return []

    def prepare(self, overrides: list[str], number: int) -> Job:
        """Compose and check one job. One that has finished, or is a mistake, need not be started."""
        config = self.context.config_loader.load_sweep_config(self.config, overrides)
        with open_dict(config):
            config.hydra.job.id = config.hydra.job.num = number
        try:
            values = plain(config)
            directory = self.directory / subdirectory(config, values)
            command = [
                *hydra_arguments(config.hydra),
                *config.hydra.overrides.task,
                f"hydra.run.dir={quoted(directory)}",
                f"hydra.sweep.dir={quoted(self.directory)}",
            ]
            job = Job(overrides, directory, command, config.threads)
        except MISTAKES as error:
            return Job(overrides, self.directory / f"job {number}", [], 1, "failed", one_line(error))
        try:
            if id(config) not in self.checked:
                check_hydra(config.hydra)
                self.checked[id(config)] = config
            HydraConfig.instance().cfg = config  # type: ignore[assignment]  # as `set_config` does, with a copy
            if check(directory, values, self.validated(config, values).domain):
                job.state = "already finished"
        except MISTAKES as error:
            job.state, job.reason = "failed", one_line(error)
        return job

    def validated(self, config: DictConfig, values: dict[str, Any]) -> Config:
        """What `validate` gives, its parts made once for all jobs that have the same. values: the plain config."""
        parts = {key: value for key, value in values.items() if isinstance(value, dict)}
        settings = json.dumps(parts)
        if settings not in self.built:
            job_config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
            self.built[settings] = build(job_config, Config)
        others = {key: value for key, value in values.items() if key not in parts}
        return check_parts(with_values(self.built[settings], others, config))

    # -- on this machine ----------------------------------------------------------------------------------------

    def run_locally(self, jobs: list[Job], total: int) -> None:
        """A few at a time, each in a process of its own; interrupted, it ends those that run."""
        threads = max(job.threads for job in jobs)
        at_once = max(1, cores() // threads) if self.jobs == "auto" else int(self.jobs)
        at_once = min(at_once, len(jobs))
        threading = f"{at_once} at once, {threads} thread{'s' * (threads > 1)} each"
        self.console.print(f"{total} runs, {len(jobs)} to do: {threading}")
        done = total - len(jobs)
        pool = ThreadPoolExecutor(at_once)
        try:
            status = self.console.status("running") if self.console.is_terminal else contextlib.nullcontext()
            with status:
                for future in as_completed([pool.submit(self.run_process, job) for job in jobs]):
                    job, seconds, crash = future.result()
                    done += 1
                    reason = f": {job.reason}" if job.failed else ""
                    self.console.print(
                        f"[{done}/{total}] {job.directory.name} {job.state}, {seconds:.0f} s{reason}", markup=False
                    )
                    if crash:
                        self.console.print(crash, markup=False)
        finally:
            self.over = True
            pool.shutdown(wait=False, cancel_futures=True)
            stop(list(self.processes))
            pool.shutdown()

    def run_process(self, job: Job) -> tuple[Job, float, str]:
        """Run a job in a process of its own. Returns it with its state, how long it took, and what a crash printed."""
        begun = time.monotonic()
        with started(job.command, job.threads) as process:
            self.processes.append(process)
            if self.over:  # it began while the others were told to end
                stop([process])
            _, said = process.communicate()
        job.reason, crash = explain(process.returncode, said)
        job.state = "failed" if job.reason else "finished"
        return job, time.monotonic() - begun, crash

    # -- elsewhere ----------------------------------------------------------------------------------------------

    def run_elsewhere(self, engine: Launcher, jobs: list[Job], total: int, first: int) -> None:
        """Hand the jobs to another launcher; each run's directory then tells what came of it."""
        self.console.print(f"{total} runs, {len(jobs)} to do: by {type(engine).__name__}")
        overrides = [[*job.overrides, f"hydra.sweep.subdir={quoted(Path(job.directory.name))}"] for job in jobs]
        trouble = ""
        try:
            for job, done in zip(jobs, engine.launch(overrides, first), strict=True):
                job.state, job.reason = ("failed", str(done.return_value)) if done.return_value else ("finished", "")
        except Exception as error:  # whatever an engine raises when one of its jobs dies
            trouble = f"{type(engine).__name__}: {one_line(error)}"
        for job in jobs:
            if not job.failed and not finished(job.directory):
                job.state = ""
            if not job.state:
                job.state, job.reason = ("finished", "") if finished(job.directory) else ("not finished", trouble)

    # -- the end ------------------------------------------------------------------------------------------------

    def summarise(self, jobs: list[Job]) -> None:
        """A line for each run."""
        self.console.print()
        for job in jobs:
            state = job.state or "not finished"
            reason = f": {job.reason}" if job.reason else ""
            self.console.print(f"{state:<17} {job.directory.name}{reason}", markup=False)


def subdirectory(config: DictConfig, values: dict[str, Any]) -> str:
    """Where in the sweep's directory a job goes. values: its plain config, which is not made again for a run's name."""
    sweep = OmegaConf.to_container(config.hydra.sweep)
    if isinstance(sweep, dict) and sweep["subdir"] == "${run_name:}":
        return name_of(values, config.hydra.runtime.choices)
    return str(config.hydra.sweep.subdir)


def run_here(cfg: DictConfig) -> str:
    """What another launcher's job does: the run in a process of its own, as on this machine. Returns why it failed.

    What ends the job ends the run too: Slurm's signals before the time is over, or Ray.
    """
    hydra = HydraConfig.get()
    directory = Path(hydra.runtime.output_dir)
    command = [*hydra_arguments(hydra), *hydra.overrides.task, f"hydra.run.dir={quoted(directory)}"]
    command.append(f"hydra.sweep.dir={quoted(directory.parent)}")
    with started(command, cfg.threads) as process:
        try:
            _, said = process.communicate()
        finally:
            stop([process])
    reason, crash = explain(process.returncode, said)
    if reason:
        print(crash or reason, file=sys.stderr)
    return reason


@contextlib.contextmanager
def started(arguments: list[str], threads: int) -> Iterator[subprocess.Popen]:
    """`python -m apf.main ARGUMENTS` in a session of its own, out of reach of Ctrl-C; it ends with this process."""
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads), FOLLOWER: "1"}
    environment.pop("HYDRA_FULL_ERROR", None)
    read, write = os.pipe()  # the process sees its end close when this one ends
    try:
        process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "apf.main", *arguments],
            stdin=read,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            env=environment,
            start_new_session=True,
        )
        os.close(read)
        with process:
            yield process
    finally:
        os.close(write)


def stop(processes: Sequence[subprocess.Popen]) -> None:
    """End processes as SIGTERM does, or hard if they do not listen."""
    running = [process for process in processes if process.poll() is None]
    for process in running:
        process.terminate()
    deadline = time.monotonic() + PATIENCE
    for process in running:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()


def explain(code: int, said: str) -> tuple[str, str]:
    """Why a process failed, in one line (empty if it did not), and the traceback if it crashed."""
    lines = said.strip().splitlines()
    last = lines[-1] if lines else ""
    if code == 0:
        return "", ""
    crash = next((n for n, line in enumerate(lines) if line.startswith(("Traceback", "Fatal Python error"))), None)
    trace = (
        "" if crash is None else "\n".join(line for line in lines[crash:] if not line.startswith("Extension modules"))
    )
    if code < 0:
        return f"killed by {signal.Signals(-code).name}", trace
    if last.startswith("error: "):
        return last.removeprefix("error: "), ""
    if last.startswith("interrupted"):
        return "interrupted", ""
    return f"exit code {code}" + (f": {last}" if trace else ""), trace


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
