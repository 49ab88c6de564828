"""Where Hydra finds the launcher of sweeps: it takes launchers from this namespace package only.

Kept light: every Hydra application that is installed beside this one imports it.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from hydra.core.config_loader import ConfigLoader
from hydra.core.utils import JobReturn
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class SweepLauncher(Launcher):
    """Runs what is missing of a sweep, each run in a process of its own, and says at the end what came of each.

    engine: one of Hydra's other launchers, to hand the runs to; None: `jobs` of them at once on this machine.
    """

    def __init__(self, jobs: int | str = "auto", engine: Launcher | None = None) -> None:
        self.jobs = jobs
        self.engine = engine

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Hydra calls this once, before `launch`.

        Args:
            hydra_context: Hydra's loaders of this sweep.
            task_function: Not used: each run is a process of its own.
            config: The config of the sweep.
        """
        from apf.launch.composing import Composer
        from apf.launch.sweep import run_here

        self.context = hydra_context
        self.config = config
        if self.engine is not None:
            self.engine.setup(hydra_context=replace(hydra_context), task_function=run_here, config=config)
        # the sweeper, which tries out all jobs before the first is launched, uses it too
        hydra_context.config_loader = cast(ConfigLoader, Composer(hydra_context.config_loader, config))

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """One run for each list of overrides."""
        from apf.launch.sweep import Sweep

        return Sweep(self.context, self.config, self.jobs, self.engine).run(job_overrides, initial_job_idx)
