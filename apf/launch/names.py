"""Names of the runs of a sweep: words that say what the sweep varied."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from apf.config.values import LENGTH, NO_EFFECT, config_hash, name_of

SAID = ("sampler", "model", "world", "seed", "predictor")
"""Keys that each name has anyway."""
UNSAFE = re.compile(r"[^\w.+-]+", re.ASCII)
"""What a name of a folder is better without."""
LONGEST = 32
"""Characters of one word."""
MOST = 100
"""Characters of all words together."""


class Names:
    """Names the runs of one sweep. A run that the sweep's folder holds already keeps its name, whatever it says."""

    def __init__(self, sweep: DictConfig, folder: Path) -> None:
        """The names that are taken.

        Args:
            sweep: The config of the sweep.
            folder: The folder of its runs.
        """
        self.varied = varied_keys(sweep)
        there = sorted(path.parent.name for path in folder.glob("*/run.yaml"))
        self.known = {name.rpartition("-")[2]: name for name in there}

    def of(self, config: DictConfig, values: dict[str, Any]) -> str:
        """The name of a job.

        Args:
            config: Of the job.
            values: The same as plain values.
        """
        words = words_for(self.varied, values, config.hydra.runtime.choices)
        return self.known.setdefault(config_hash(values), name_of(values, config.hydra.runtime.choices, words))


def varied_keys(sweep: DictConfig) -> list[str]:
    """The keys for which a sweep has several values, from its command line and its sweeper, in their order."""
    typed = OmegaConf.to_container(sweep.hydra.overrides.task, resolve=False)
    overrides = OverridesParser.create().parse_overrides(typed)  # type: ignore[arg-type]
    keys = [override.key_or_group for override in overrides if override.is_sweep_override()]
    keys += [str(key).lstrip("+~") for key in OmegaConf.select(sweep, "hydra.sweeper.params") or ()]
    return list(dict.fromkeys(keys))


def words_for(varied: Sequence[str], values: Mapping[str, Any], choices: Mapping[str, Any]) -> list[str]:
    """A word for each varied key that a name does not have anyway, as `learning_rate_0.001`.

    No word has a `=`: on a command line, Hydra would have to be given it in quotes.

    Args:
        varied: Keys and groups.
        values: The plain config.
        choices: What was chosen of each group.
    """
    keys = [
        key for key in varied if key.partition("@")[0] not in (*SAID, LENGTH) and key.split(".")[0] not in NO_EFFECT
    ]
    lasts = [re.split(r"[./@]", key)[-1] for key in keys]
    words: list[str] = []
    for key, last in zip(keys, lasts):
        value = choices[key] if key in choices else _value(key, values)
        name = last if lasts.count(last) == 1 else key
        word = f"{_safe(name)}_{_safe(_shown(value))}"
        if len("-".join([*words, word])) <= MOST:
            words.append(word)
    return words


def _value(key: str, values: Mapping[str, Any]) -> Any:
    node: Any = values
    for part in key.split("."):
        node = node.get(part) if isinstance(node, Mapping) else None
    return list(node) if isinstance(node, Mapping) else node


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return "+".join(map(_shown, value))
    if isinstance(value, bool) or value is None:
        return "null" if value is None else str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _safe(text: str) -> str:
    return UNSAFE.sub("_", text)[:LONGEST]
