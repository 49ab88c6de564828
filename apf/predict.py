"""python -m apf.predict: how likely is each prefix of somebody's own plans to succeed?"""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="predict")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Read, predict, say what was found, write one row per placement."""
    from apf.commands.predict import work  # here: help and completion do not wait for PyTorch

    work(cfg)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "predict")


if __name__ == "__main__":
    main()
