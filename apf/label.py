"""python -m apf.label: label every prefix of somebody's own plans."""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="label")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Read, execute, write one row per placement: the plan's name, position, label (empty after the first fall)."""
    from apf.commands.label import work  # here: help and completion do not wait for PyTorch

    work(cfg)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "label")


if __name__ == "__main__":
    main()
