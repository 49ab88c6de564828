"""python -m apf.panda.show tower=FILE: build a tower, clear it up, and film it."""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command
from apf.panda import needs_extra


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="show")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Build a tower, clear it up, and film it."""
    with needs_extra("apf.panda.show"):
        from apf.panda.commands.show import work  # here: help and completion do not wait for PyBullet and PyTorch

    work(cfg)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "show")


if __name__ == "__main__":
    main()
