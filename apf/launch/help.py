"""The page that `--help` prints, as Hydra would print it: Hydra takes a second to list the config groups."""

from collections.abc import Mapping
from pathlib import Path

from omegaconf import OmegaConf

from apf.config.values import config_dir, sweeps_dir

ASKED = (["--help"], ["-h"])
"""Arguments that ask for the page and for nothing else. Hydra answers a longer command line."""

NOT_SHOWN = ("hydra",)
"""Folders of configs that are no choices of a run: Hydra's own groups."""


def page(name: str) -> str:
    """The page of `conf/hydra/help/NAME.yaml`, with the options of all config groups, and the sweeps.

    What else lies with the sweeps, e.g. samplers that one of them alone needs, is not shown.
    """
    help_of_hydra = OmegaConf.load(Path(config_dir(), "hydra", "help", f"{name}.yaml"))
    text = str(OmegaConf.create({"hydra": {"help": help_of_hydra}}).hydra.help.template)
    own, sweeps = Path(config_dir()), Path(sweeps_dir().removeprefix("file://"))
    return text.replace("$APP_CONFIG_GROUPS", choices({own: "**/*.yaml", sweeps: "experiment/*.yaml"}))


def choices(folders: Mapping[Path, str]) -> str:
    """A line for each config group that the folders hold, with its options.

    Args:
        folders: The pattern of the files that are options, by folder.
    """
    groups: dict[str, set[str]] = {}
    for folder, pattern in folders.items():
        for path in folder.glob(pattern):
            group = path.parent.relative_to(folder)
            if group.parts and group.parts[0] not in NOT_SHOWN:
                groups.setdefault(group.as_posix(), set()).add(path.stem)
    return "".join(f"{group}: {', '.join(sorted(options))}\n" for group, options in sorted(groups.items()))
