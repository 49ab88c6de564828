"""python -m apf.panda.sheets blocks=FILE: sheets with the markers of real blocks, to be printed and cut out."""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command
from apf.panda import needs_extra


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="sheets")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Read the blocks, write the sheets."""
    with needs_extra("apf.panda.sheets"):
        from apf.panda.commands.sheets import work  # here: help and completion do not wait for PyBullet and PyTorch

    work(cfg)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "sheets")


if __name__ == "__main__":
    main()
