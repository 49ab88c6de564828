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

from apf.config.build import build
from apf.config.messages import check_hydra
from apf.config.values import plain, understood
from apf.errors import InputError, Stopped
from apf.interrupts import Interrupted
from apf.launch.cli import FOLLOWER, MISTAKES, one_line
from apf.launch.machine import check_machine, cores
from apf.launch.names import Names
from apf.planning.objective import Objective, must_be_number, optimises, outcome, returned
from apf.rundir.directory import as_typed, check, finished, hydra_arguments, output_directory
from apf.rundir.resume import quoted
from apf.schema import Config, check_together, with_values
from apf.terminal import console
from apf.tracking import Board, ProgressFile
from apf.tracking.progress import still

PATIENCE = 20.0
"""Seconds that a run has to end after SIGTERM."""
AGAIN = "the same command again does what is missing"


@dataclass
class Job:
    """One run of a sweep. state: empty until it is known what came of it. reason: of a failure.

    value: of the objective, once the run has finished with as many plans.
    """

    overrides: list[str]
    directory: Path
    command: list[str]
    threads: int
    state: str = ""
    reason: str = ""
    objective: Objective = ()
    plans: int = 0
    value: float | tuple[float, ...] | None = None

    @property
    def failed(self) -> bool:
        """Did it not finish?"""
        return self.state not in ("finished", "already finished")


class Sweep:
    """All runs of one sweep command."""

    def __init__(self, context: HydraContext, config: DictConfig, jobs: int | str, engine: Launcher | None) -> None:
        """No job is started yet.

        Args:
            context: Hydra's loaders.
            config: The config of the sweep.
            jobs: Number of runs at once, or `auto`. An engine ignores this number.
            engine: Another launcher, to which the runs are handed; None: they run on this machine.

        Raises:
            InputError: `jobs` is neither `auto` nor a positive number, or the sweeper needs an objective.
        """
        if engine is None and jobs != "auto" and (type(jobs) is not int or jobs < 1):
            raise InputError(f"hydra.launcher.jobs is {jobs!r}; it must be auto or a positive number")
        self.context, self.config, self.jobs, self.engine = context, config, jobs, engine
        self.directory = Path(config.hydra.sweep.dir).absolute()
        self.names = Names(config, self.directory)
        self.console = console(stderr=True)
        self.processes: list[subprocess.Popen] = []
        self.checked: dict[int, DictConfig] = {}
        """By their ids, configs in which Hydra's own part is right."""
        self.built: dict[str, Config] = {}
        """By the settings that they were made of: parts, which the jobs that have them share."""
        self.over = False
        self.optimised = optimises(config.hydra, config.get("objective"))

    def run(self, job_overrides: Sequence[Sequence[str]], first: int) -> list[JobReturn]:
        """Start the runs that are missing, wait for them, and print a summary.

        Returns:
            For each list of overrides, in their order, Hydra's record of the job. Its `return_value` is the objective,
            if there is one; for a run that did not finish, it raises Stopped.
        """
        jobs: dict[Path, Job] = {}
        asked: list[tuple[list[str], Path]] = []
        for number, overrides in enumerate(job_overrides, first):
            job = self.prepare(list(overrides), number)
            jobs.setdefault(job.directory, job)  # jobs of one directory are one run
            asked.append((job.overrides, job.directory))
        missing = [job for job in jobs.values() if not job.state]
        try:
            if missing and self.engine is None:
                self.run_locally(missing, len(jobs))
            elif missing and self.engine is not None:
                self.run_elsewhere(self.engine, missing, len(jobs), first)
        except KeyboardInterrupt as error:
            raise Interrupted(getattr(error, "number", 2), f"interrupted; {AGAIN}") from None
        finally:
            self.look_up_objectives(list(jobs.values()))
            self.summarise(list(jobs.values()))
        failed = sum(job.failed for job in jobs.values())
        stopped = Stopped(f"{failed} of {len(jobs)} runs did not finish; {AGAIN}")
        came = [(overrides, jobs[directory]) for overrides, directory in asked]
        return [outcome(o, job.directory, job.value, stopped if job.failed else None) for o, job in came]

    def prepare(self, overrides: list[str], number: int) -> Job:
        """Compose and check one job. A job that has finished, or whose config is wrong, is not started."""
        config = self.context.config_loader.load_sweep_config(self.config, overrides)
        with open_dict(config):
            config.hydra.job.id = config.hydra.job.num = number
        try:
            values = plain(config)
            directory = self.directory / self.subdirectory(config, values)
            command = [
                *hydra_arguments(config.hydra),
                *as_typed(config.hydra.overrides.task),
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
            parts = self.validated(config, values)
            if self.engine is None:
                check_machine(parts)
            job.objective, job.plans = parts.objective, parts.plans
            if check(directory, understood(values, parts), parts.domain):
                job.state = "already finished"
        except MISTAKES as error:
            job.state, job.reason = "failed", one_line(error)
        return job

    def subdirectory(self, config: DictConfig, values: dict[str, Any]) -> str:
        """Where in the sweep's directory a job goes. values: its plain config."""
        sweep = OmegaConf.to_container(config.hydra.sweep)
        if isinstance(sweep, dict) and sweep["subdir"] == "${run_name:}":
            return self.names.of(config, values)
        return str(config.hydra.sweep.subdir)

    def validated(self, config: DictConfig, values: dict[str, Any]) -> Config:
        """The checked config of a job. Jobs with the same parts share the objects. values: the job's plain config."""
        parts = {key: value for key, value in values.items() if isinstance(value, dict)}
        settings = json.dumps(parts)
        if settings not in self.built:
            job_config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
            self.built[settings] = build(job_config, Config)
        others = {key: value for key, value in values.items() if key not in parts}
        config_of_job = with_values(self.built[settings], others, config)
        check_together(config_of_job)
        return config_of_job

    # -- on this machine ----------------------------------------------------------------------------------------

    def run_locally(self, jobs: list[Job], total: int) -> None:
        """A few at a time, each in a process of its own; interrupted, it ends those that run."""
        threads = max(job.threads for job in jobs)
        at_once = max(1, cores() // threads) if self.jobs == "auto" else int(self.jobs)
        at_once = min(at_once, len(jobs))
        threading = f"{at_once} at once, {threads} thread{'s' * (threads > 1)} each"
        self.console.print(f"{total} runs, {len(jobs)} to do: {threading}")
        board = Board(self.console, total, total - len(jobs), at_once)
        pool = ThreadPoolExecutor(at_once)
        try:
            with board.shown():
                for number, future in enumerate(
                    as_completed([pool.submit(self.run_process, job, board) for job in jobs]), total - len(jobs) + 1
                ):
                    job, seconds, crash = future.result()
                    reason = f": {job.reason}" if job.failed else ""
                    left = f"; {still(*board.left())}" if number < total else ""
                    self.console.print(
                        f"[{number}/{total}] {job.directory.name} {job.state}, {seconds:.0f} s{reason}{left}"
                    )
                    if crash:
                        self.console.print(crash)
        finally:
            self.over = True
            pool.shutdown(wait=False, cancel_futures=True)
            stop(list(self.processes))
            pool.shutdown()

    def run_process(self, job: Job, board: Board) -> tuple[Job, float, str]:
        """Run a job in a process of its own. Returns it with its state, how long it took, and what a crash printed."""
        with started(job.command, job.threads, board.started(job.directory.name)) as process:
            self.processes.append(process)
            if self.over:  # it began while the others were told to end
                stop([process])
            _, said = process.communicate()
        job.reason, crash = explain(process.returncode, said)
        job.state = "failed" if job.reason else "finished"
        return job, board.ended(job.directory.name), crash

    # -- elsewhere ----------------------------------------------------------------------------------------------

    def run_elsewhere(self, engine: Launcher, jobs: list[Job], total: int, first: int) -> None:
        """Hand the jobs to another launcher; each run's directory then tells what came of it.

        Args:
            engine: Another of Hydra's launchers.
            jobs: What is to be done.
            total: The number of all jobs of the sweep.
            first: The number of the first job.
        """
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

    def look_up_objectives(self, jobs: list[Job]) -> None:
        """From the tables of the runs that have finished. Where a sweeper compares them, each must be a number."""
        for job in jobs:
            if job.failed:
                continue
            try:
                job.value = returned(job.directory, job.objective, job.plans)
                if self.optimised:
                    must_be_number(job.value)
            except (Stopped, OSError) as error:
                job.state, job.reason = "failed", one_line(error)

    def summarise(self, jobs: list[Job]) -> None:
        """A line for each run."""
        self.console.print()
        for job in jobs:
            state = job.state or "not finished"
            reason = f": {job.reason}" if job.reason else ""
            value = f": {job.value}" if job.value is not None else ""
            self.console.print(f"{state:<17} {job.directory.name}{reason or value}")


def run_here(cfg: DictConfig) -> str:
    """What another launcher's job does: the run in a process of its own, as on this machine. Returns why it failed.

    What ends the job ends the run too: Slurm's signals before the time is over, or Ray.
    """
    hydra = HydraConfig.get()
    directory = output_directory(hydra)
    command = [*hydra_arguments(hydra), *as_typed(hydra.overrides.task), f"hydra.run.dir={quoted(directory)}"]
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
def started(arguments: list[str], threads: int, progress: Path | None = None) -> Iterator[subprocess.Popen]:
    """`python -m apf.main ARGUMENTS` in a session of its own, out of reach of Ctrl-C; it ends with this process.

    Args:
        arguments: Of the command line.
        threads: Of the process.
        progress: The file in which the process tells how far it is.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads), FOLLOWER: "1"}
    environment.pop("HYDRA_FULL_ERROR", None)
    environment.pop(ProgressFile.VARIABLE, None)
    if progress:
        environment[ProgressFile.VARIABLE] = str(progress)
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
