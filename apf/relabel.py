"""python -m apf.relabel: what an operator saw of a plan differs from what was recorded."""

import hydra
from omegaconf import DictConfig

from apf.config.values import config_dir
from apf.launch.cli import one_line_errors, run_command


@hydra.main(version_base="1.3", config_path=config_dir(), config_name="relabel")
@one_line_errors
def job(cfg: DictConfig) -> None:
    """Record the correction; the tables follow at once, what was learned since at the next resume."""
    from apf.commands.relabel import work  # here: help and completion do not wait for PyTorch

    work(cfg)


def main() -> None:
    """Entry point of the command."""
    run_command(job, "relabel")


if __name__ == "__main__":
    main()
