"""python -m apf.main: compose, check, run, report."""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="config")
@one_line_errors
def job(cfg: DictConfig) -> float | tuple[float, ...] | None:
    """One run, in Hydra's output directory. Returns the run's objective, for a sweeper."""
    from apf.commands.run import work  # here: help and completion do not wait for PyTorch

    return work(cfg)


def resumed(arguments: list[str]) -> list[str]:
    """The command line with `resume=DIR` replaced, if it is there."""
    if not any(text.startswith("resume=") for text in arguments):
        return arguments
    from apf.rundir import resume
    from apf.schema import Config

    return resume.resumed(arguments, Config.__dataclass_fields__)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "apf", resumed)


if __name__ == "__main__":
    main()
