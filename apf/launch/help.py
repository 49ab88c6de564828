"""The page that `--help` prints, as Hydra would print it: Hydra takes a second to list the config groups."""

from pathlib import Path

from omegaconf import OmegaConf

from apf.config.values import config_dir, sweeps_dir

ASKED = (["--help"], ["-h"])
"""Arguments that ask for the page and for nothing else. Hydra answers a longer command line."""

NOT_SHOWN = ("hydra", "wandb")
"""Folders of configs that are no choices of a run: Hydra's own groups, and sweeps for `wandb agent`."""


def page(name: str) -> str:
    """The page of `conf/hydra/help/NAME.yaml`, with the options of all config groups."""
    help_of_hydra = OmegaConf.load(Path(config_dir(), "hydra", "help", f"{name}.yaml"))
    text = str(OmegaConf.create({"hydra": {"help": help_of_hydra}}).hydra.help.template)
    folders = [Path(config_dir()), Path(sweeps_dir().removeprefix("file://"))]
    return text.replace("$APP_CONFIG_GROUPS", choices(folders))


def choices(folders: list[Path]) -> str:
    """A line for each config group that the folders hold, with its options."""
    groups: dict[str, set[str]] = {}
    for folder in folders:
        for path in folder.rglob("*.yaml"):
            group = path.parent.relative_to(folder)
            if group.parts and group.parts[0] not in NOT_SHOWN:
                groups.setdefault(group.as_posix(), set()).add(path.stem)
    return "".join(f"{group}: {', '.join(sorted(options))}\n" for group, options in sorted(groups.items()))
