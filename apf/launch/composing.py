"""The configs of a sweep's jobs. Hydra takes a tenth of a second for each; most differ in a seed alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from hydra.core.config_loader import ConfigLoader
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException


@dataclass
class Family:
    """A family of jobs (see `Composer`): the config and the overrides of the last one that was composed."""

    config: DictConfig
    overrides: list[Override]

    def become(self, overrides: list[Override]) -> None:
        """Turn the config into that of another job of the family, with Hydra's own record of the overrides."""
        hydra = self.config.hydra
        OmegaConf.set_readonly(hydra, False)
        task = [o for o in overrides if not o.is_hydra_override()]
        before = [o for o in self.overrides if not o.is_hydra_override()]
        for place, (old, new) in enumerate(zip(before, task, strict=True)):
            if new.input_line != old.input_line:
                OmegaConf.update(self.config, new.key_or_group, new.value(), merge=True)
                hydra.overrides.task[place] = new.input_line
        style = hydra.job.config.override_dirname
        lines = sorted(str(o.input_line) for o in task if o.key_or_group not in style.exclude_keys)
        hydra.job.override_dirname = style.item_sep.join(lines).replace("=", style.kv_sep)
        self.overrides = overrides


class Composer:
    """Hydra's loader of configs, faster for the jobs of a sweep.

    Hydra first composes the chosen options of config groups, and then sets values one after another. An override is
    *plain* if its value is no mapping, and no other override touches the same key. Jobs that differ in the values of
    plain overrides alone are a *family*. Hydra composes the first job of a family. For each other job, the values are
    set in the same config. A config is therefore valid only until the next job of its family is composed.
    """

    def __init__(self, loader: ConfigLoader, master: DictConfig) -> None:
        """master: the config of the sweep, whose jobs are to be composed."""
        self.loader, self.master = loader, master
        self._families: dict[tuple[str, ...], Family] = {}
        self._plain_keys: dict[str, bool] = {}

    def __getattr__(self, name: str) -> Any:
        """All other attributes are those of Hydra's own loader."""
        return getattr(self.loader, name)

    def load_sweep_config(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        """The config of a job, equal to the one of Hydra's own loader. Raises the same errors."""
        try:
            overrides = [parsed(text) for text in sweep_overrides]
        except HydraException:
            return self.loader.load_sweep_config(master_config, sweep_overrides)  # for the message
        keys = self.plain_keys(overrides)
        name = tuple(o.key_or_group if o.key_or_group in keys else str(o.input_line) for o in overrides)
        family = self._families.pop(name, None)
        if family is None:
            family = Family(self.loader.load_sweep_config(master_config, sweep_overrides), overrides)
        else:
            try:
                family.become(overrides)
            except OmegaConfBaseException:
                return self.loader.load_sweep_config(master_config, sweep_overrides)  # for the message
            OmegaConf.copy_cache(from_config=master_config, to_config=family.config)
        self._families[name] = family
        return family.config

    def plain_keys(self, overrides: Sequence[Override]) -> set[str]:
        """Keys whose overrides are plain."""
        keys = [o.key_or_group for o in overrides]
        plain = {o.key_or_group for o in overrides if self.sets_a_value(o) and keys.count(o.key_or_group) == 1}
        others = [f"{key}." for key in keys if key not in plain]
        return {key for key in plain if not any(f"{key}.".startswith(other) for other in others)}

    def sets_a_value(self, override: Override) -> bool:
        """`key=value`, where the key is in the sweep's config and no config group, and no value is a mapping?"""
        key = override.key_or_group
        if key not in self._plain_keys:
            self._plain_keys[key] = self.is_value(key) and not self.is_group(key)
        changes = not (override.is_add() or override.is_force_add() or override.is_delete() or override.package)
        simple = not override.is_sweep_override() and not isinstance(override.value(), dict)
        return changes and simple and self._plain_keys[key]

    def is_value(self, key: str) -> bool:
        """Is there a value of this key in the sweep's own config?"""
        above, _, last = key.rpartition(".")
        try:
            node = OmegaConf.select(self.master, above) if above else self.master
            if key.startswith("hydra.") or not isinstance(node, DictConfig) or last not in node:
                return False
            return OmegaConf.is_interpolation(node, last) or not isinstance(node[last], DictConfig)
        except OmegaConfBaseException:
            return False

    def is_group(self, key: str) -> bool:
        """Is it a group of configs, of which options can be chosen?"""
        hydra = self.master.hydra
        given = OmegaConf.to_container(hydra.overrides.hydra)
        return bool(self.loader.get_group_options(key, None, hydra.job.config_name, given))  # type: ignore[arg-type]


@cache
def parsed(text: str) -> Override:
    """An override of the command line, read. Raises HydraException."""
    return OverridesParser.create().parse_overrides([text])[0]
