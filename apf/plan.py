"""python -m apf.plan objects=FILE task=NAME run=DIR: the best plans found for somebody's own objects."""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="plan")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Plan, say what was found, and write it."""
    from apf.commands.plan import work  # here: help and completion do not wait for PyTorch

    work(cfg)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "plan")


if __name__ == "__main__":
    main()
