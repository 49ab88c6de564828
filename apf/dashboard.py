"""python -m apf.dashboard [KEY=VALUE ...]: a workspace and a report at Weights & Biases, for the runs of a project.

Both show regret, success and accuracy over labelled plans, a line for each sampler: the median of its runs, and their
range. The arguments are those of the runs (`task=[...]`, `tracker.wandb.project=mine`); `--dry-run` prints what
would be made, and makes nothing. So does an environment in which W&B is offline.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pydantic
from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from apf.config.values import config_dir
from apf.launch.cli import one_line
from apf.source import version_line

GROUP_BY = "sampler"
"""Key of a W&B run's config: runs that agree in it are one line."""
TITLE = "Active learning of abstract plan feasibility"
MEASURED = {"accuracy": "Accuracy", "auc": "AUC", "nll": "Negative log-likelihood", "ece": "Calibration error"}
"""The measures of predictions, and what they are called."""
SOMEBODY = "your-entity"
"""Stands for the entity of whoever is logged in, where W&B is not asked."""


@dataclass(frozen=True)
class Section:
    """Curves that stand together: a title, and the names of metrics."""

    title: str
    metrics: tuple[str, ...]


def sections(config: DictConfig) -> list[Section]:
    """The metrics of the runs of a config, in the order in which people ask for them."""
    pairs = [f"{world}/{task}" for task in config.task for world in config.evaluation.worlds]
    return [
        Section("Median regret", tuple(f"regret/{pair}" for pair in pairs)),
        Section("Share of chosen plans that succeed", tuple(f"success/{pair}" for pair in pairs)),
        *(
            Section(f"{title} by length", tuple(f"{name}/{length}" for length in config.evaluation.lengths))
            for name, title in MEASURED.items()
        ),
        Section("Learning", ("loss/train", "data/feasible_share", "score/mean")),
    ]


def pictures(config: DictConfig) -> list[str]:
    """The names of the pictures of chosen plans."""
    return [f"chosen/{task}" for task in config.task]


def panels(metrics: Sequence[str]) -> list[Any]:
    """A panel for each metric: over labelled plans, the median of each group and the range of its runs."""
    from wandb_workspaces.reports import v2

    return [
        v2.LinePlot(
            title=metric,
            x="plans",
            y=[metric],
            title_x="labelled plans",
            groupby=v2.Config(GROUP_BY),
            groupby_aggfunc="median",
            groupby_rangefunc="minmax",
        )
        for metric in metrics
    ]


def workspace(config: DictConfig, entity: str, project: str) -> Any:
    """The workspace of a project.

    Args:
        config: Of the runs.
        entity: At W&B.
        project: At W&B.
    """
    from wandb_workspaces import workspaces
    from wandb_workspaces.reports import v2

    made = [
        workspaces.Section(name=section.title, panels=panels(section.metrics), is_open=True)
        for section in sections(config)
    ]
    made.append(workspaces.Section(name="Chosen plans", panels=[v2.MediaBrowser(media_keys=pictures(config))]))
    runs = workspaces.RunsetSettings(groupby=[workspaces.Config(GROUP_BY)])
    return workspaces.Workspace(entity=entity, project=project, name=TITLE, sections=made, runset_settings=runs)


def report(config: DictConfig, entity: str, project: str) -> Any:
    """The report of a project.

    Args:
        config: Of the runs.
        entity: At W&B.
        project: At W&B.
    """
    from wandb_workspaces.reports import v2

    runs = v2.Runset(entity=entity, project=project, groupby=[f"config.{GROUP_BY}"])
    parts: list[Any] = [v2.P("Lines are medians over the runs of a sampler, bands their range.")]
    for section in sections(config):
        parts += [v2.H2(section.title), v2.PanelGrid(runsets=[runs], panels=panels(section.metrics))]
    browser = v2.MediaBrowser(media_keys=pictures(config))
    parts += [v2.H2("Chosen plans"), v2.PanelGrid(runsets=[runs], panels=[browser])]
    return v2.Report(project, entity, TITLE, "", parts)


def as_json(made: Any) -> str:
    """All of a workspace or a report."""
    return pydantic.TypeAdapter(type(made)).dump_json(made, indent=2).decode()


def main() -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dry-run", action="store_true", help="print what would be made, and make nothing")
    parser.add_argument("--version", action="version", version=version_line())
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="of the runs, as for python -m apf.main")
    arguments = parser.parse_args()
    try:
        with initialize_config_dir(config_dir(), version_base="1.3"):
            config = compose("config", arguments.overrides)
            if "wandb" not in config.tracker:
                raise HydraException("tracker: the dashboard is for tracker=wandb")
            entity, project = config.tracker.wandb.entity, config.tracker.wandb.project
    except (HydraException, OmegaConfBaseException) as error:
        sys.exit(f"error: {one_line(error)}")
    dry = arguments.dry_run or os.environ.get("WANDB_MODE") in ("offline", "dryrun", "disabled")
    try:
        made = [workspace(config, entity or SOMEBODY, project), report(config, entity or SOMEBODY, project)]
    except ModuleNotFoundError as error:
        sys.exit(f"error: {error.name} is not installed; pip install 'apf[reports]'")
    if not dry:
        try:
            save(config, entity, project)
            return
        except Exception as error:  # whatever W&B raises without a network or a login
            print(f"error: W&B cannot be reached, nothing was made: {one_line(error)}; below is what", file=sys.stderr)
    print("[" + ",\n".join(map(as_json, made)) + "]")
    sys.exit(0 if dry else 1)


def save(config: DictConfig, entity: str | None, project: str) -> None:
    """Make workspace and report at W&B, and print their addresses.

    Args:
        config: Of the runs.
        entity: At W&B; None: that of whoever is logged in.
        project: At W&B.
    """
    import wandb

    known = entity or str(wandb.Api().default_entity)
    for made in (workspace(config, known, project), report(config, known, project)):
        print(made.save().url)


if __name__ == "__main__":
    main()
