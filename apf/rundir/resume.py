"""Going on with a run from what its directory keeps, which is data: maybe somebody else's, maybe edited by hand."""

import copy
import os
import re
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.types import Quote, QuotedString

from apf.config.values import KEPT_DOMAIN
from apf.errors import InputError
from apf.rundir.claim import CONFIG, JOURNAL, LOCK, LOGS, STATE, TABLES, WORLD_TABLE
from apf.rundir.kept import read_config, read_state

RESUME = "resume"
"""Name of the config that a resumed run is composed from, `conf/resume.yaml`."""
KEPT_RUN = "kept_run"
"""Name of the part of it that the run directory fills."""
GROUP = re.compile(r"(?P<group>(?!hydra\b)[\w-]+(?:/[\w-]+)*)(?:@(?P<package>[\w-]+(?:\.[\w-]+)*))?")
"""A config group, and which key it fills if that is not its own name, as `run.yaml` has them."""
DEEPEST = 30
"""So deep may the values of a config be nested."""
NOT_WITH_RESUME = ("-m", "--multirun", "hydra.mode=")
ITS_OWN = ("hydra.run.dir=", "--config-name", "-cn")


def resumed(arguments: list[str], known: Collection[str]) -> list[str]:
    """The command line with `resume=DIR` replaced: Hydra composes what DIR keeps, and what else the line says wins.

    Args:
        arguments: Of the command line.
        known: The keys of a run's config.

    Raises:
        InputError: There is no run to go on with, or its directory is none.
    """
    resume = [text for text in arguments if text.startswith("resume=")]
    if not resume:
        return arguments
    others = [text for text in arguments if text not in resume]
    if len(resume) > 1 or any(text.lstrip("+~").startswith(NOT_WITH_RESUME) for text in others):
        raise InputError("resume takes one run directory; a sweep goes on with its own command")
    for text in others:
        if text.lstrip("+~").startswith(ITS_OWN):
            raise InputError(f"{text}: leave it out; resume=DIR goes on in DIR, with the config that is kept there")
    directory = Path(resume[0].partition("=")[2]).absolute()
    if not ((directory / CONFIG).exists() and (directory / STATE).exists()):
        raise InputError(f"resume={directory}: no run there; give a directory that holds {CONFIG} and {STATE}")
    shut_off(directory)
    config, state = kept_config(directory, known), read_state(directory)
    store(directory, config, state["choices"])
    return [*others, "--config-name", RESUME]


def shut_off(directory: Path) -> None:
    """Nothing in the directory is imported, and nothing outside is written by way of it.

    Raises InputError if a file that a run writes is a link that leads out of the directory.
    """
    home = directory.resolve()
    sys.path[:] = [entry for entry in sys.path if not _is_inside(Path(entry or "."), home)]
    names = (CONFIG, STATE, JOURNAL, LOCK, *TABLES, WORLD_TABLE, "run.log", "*.csv", "weights", "figures", LOGS)
    for name in (*names, "weights/*", "figures/*", f"{LOGS}/*", "wandb"):
        for path in directory.glob(name):
            if path.is_symlink() and not _is_inside(path, home):
                raise InputError(f"{path} is a link out of the run directory; put what it points to in its place")


def _is_inside(path: Path, home: Path) -> bool:
    try:
        return path.resolve().is_relative_to(home)
    except (OSError, RuntimeError):  # a loop of links
        return False


def kept_config(directory: Path, known: Collection[str]) -> dict[str, Any]:
    """The plain config that a run directory keeps. Raises InputError if its keys are not the known ones."""
    path = directory / CONFIG
    config = read_config(directory)
    for key in config:
        if key not in known:
            raise InputError(f"{path}: {key}: there is no such key; known here: {', '.join(known)}")
    for key in known:
        if key not in config:
            raise InputError(f"{path}: {key} is missing")
    level: list[Any] = [config]
    for _ in range(DEEPEST):
        level = [
            inner
            for node in level
            for inner in (node.values() if isinstance(node, dict) else node)
            if isinstance(inner, dict | list)
        ]
    if level:
        raise InputError(f"{path}: nested more than {DEEPEST} deep")
    return config


def store(directory: Path, config: dict[str, Any], choices: Any) -> None:
    """Put a kept config where Hydra finds it as `kept_run`.

    What was chosen of a config group is an option `kept_...` of that group, so that another can be chosen in its place.

    Args:
        directory: Where the run goes on.
        config: What was kept.
        choices: Of each config group, as `run.yaml` has them; those that fill no key are passed over.
    """
    rest, defaults = copy.deepcopy(config), list[dict[str, Any]]()
    matches = [GROUP.fullmatch(key) for key in map(str, choices)] if isinstance(choices, Mapping) else []
    filled = [(match["package"] or match["group"].replace("/", "."), match) for match in matches if match]
    for package, match in sorted(filled, key=lambda one: (-one[0].count("."), one[0])):
        *outer, last = package.split(".")
        node: Any = rest
        for name in outer:
            node = node.get(name) if isinstance(node, Mapping) else None
        if not (isinstance(node, dict) and isinstance(node.get(last), dict)):
            continue
        option = f"kept_{package.replace('.', '_')}"
        _add(option, node[last], package, match["group"])
        node[last] = {}  # keys keep their order
        many = isinstance(choices[match[0]], list)
        entry = {match[0]: [option] if many else option}
        if package == "domain":  # last: others follow it
            KEPT_DOMAIN[option] = str(choices[match[0]])
            defaults.append(entry)
        else:
            defaults.insert(0, entry)
    where = {"run": {"dir": as_literal(str(directory))}}
    if "defaults" in rest:
        raise InputError(f"{directory / CONFIG}: defaults: there is no such key")
    node = {**as_literal(rest), "hydra": where, "defaults": ["_self_", *defaults]}
    ConfigStore.instance().store(name=KEPT_RUN, node=node, provider="apf")


def _add(option: str, node: dict[str, Any], package: str, group: str) -> None:
    if "defaults" in node:  # Hydra would take it for a list of configs
        raise InputError(f"{CONFIG}: {package}.defaults: there is no such key")
    ConfigStore.instance().store(group=group, name=option, node=as_literal(node), provider="apf")


def as_literal(node: Any) -> Any:
    """Plain containers and values, escaped so that OmegaConf gives them back as they are.

    No text of them refers to anything.
    """
    if isinstance(node, dict):
        return {name: as_literal(value) for name, value in node.items()}
    if isinstance(node, list):
        return [as_literal(item) for item in node]
    if isinstance(node, str):
        return re.sub(r"(\\*)\$\{", lambda match: match[1] * 2 + r"\${", node)
    return node


def quoted(value: Path | str) -> str:
    """A path or another text as a value in Hydra's override grammar."""
    return QuotedString(as_literal(str(value)), Quote.single).with_quotes()


def go_where_it_began(directory: Path) -> None:
    """Relative paths of a kept config mean what they meant at first, if that folder is there still."""
    cwd = read_state(directory)["cwd"]
    if Path(cwd).is_dir() and not _is_inside(Path(cwd), directory.resolve()):
        os.chdir(cwd)
