"""One line on what is wrong with a config: the key, its value, what would be right."""

import difflib
from collections.abc import Sequence
from typing import Any

import pydantic
from hydra.conf import HydraConf
from omegaconf import DictConfig, OmegaConf

from apf.errors import InputError, shown


def no_such_key(where: str, node: DictConfig | None) -> str:
    """One line on a key that is unknown in its part of a config: the one that was meant, or all that there are."""
    key = where.rpartition(".")[2]
    known = [str(k) for k in node or () if str(k) not in (key, "_target_", "_partial_", "hydra")]
    close = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known) or 'nothing'}"
    return f"{where}: there is no such key; {hint}"


def describe(error: pydantic.ValidationError, key: str, cfg: DictConfig) -> str:
    """One line on the first thing that is wrong: its key, its value, and what would be right.

    Args:
        error: What pydantic found.
        key: The config key that pydantic was given; empty for the whole config.
        cfg: The config.
    """
    first = error.errors()[0]
    where = location(first["loc"], key, cfg, last=first["type"] not in ABSENT)
    if first["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        node = OmegaConf.select(cfg, where.rpartition(".")[0]) if "." in where else cfg
        return no_such_key(where, node)
    if first["type"] in ABSENT and isinstance(first["loc"][-1], int):
        return f"{where.rpartition('.')[0]} is {shown(list(first['input']))}; it should hold more values"
    if first["type"] in ABSENT:
        return f"{where} is missing; give it as {where}=..."
    reason = first["msg"].removeprefix("Value error, ").replace("Input should be", "it should be")
    if first["type"] == "value_error":
        return f"{where}: {reason}" if where else reason
    if first["type"] == "string_type" and isinstance(first["input"], int | float):
        reason += f"; a text that looks like a number has quotes of its own: '{where}=\"{shown(first['input'])}\"'"
    return f"{where} is {shown(first['input'])}; {reason}"


ABSENT = ("missing", "missing_argument", "missing_keyword_only_argument")
"""What pydantic calls a field that is not there."""


def location(parts: Sequence[int | str], key: str, cfg: DictConfig, last: bool) -> str:
    """The key of what pydantic complains of, below `key`: its own words for the options of a union are left out.

    Args:
        parts: The place, as pydantic names it.
        key: The key that pydantic was given.
        cfg: The config.
        last: Must the last part be there, too?
    """
    node: Any = OmegaConf.to_container(cfg)
    for name in filter(None, key.split(".")):
        node = node.get(name) if isinstance(node, dict) else None
    where = [key] if key else []
    for number, part in enumerate(parts):
        inside = part in node if isinstance(node, dict) else isinstance(node, list) and part in range(len(node))
        if inside or not (last or number < len(parts) - 1):
            where.append(str(part))
            node = node[part] if inside else None
    return ".".join(where)


def check_hydra(hydra: Any, schema: Any = None, prefix: str = "hydra.") -> None:
    """Raises InputError for a key of Hydra's own part of the config that Hydra does not know: `+` adds any.

    Args:
        hydra: Hydra's part of the config.
        schema: The keys that Hydra knows; None: all of its own.
        prefix: The key of this part.
    """
    schema = OmegaConf.structured(HydraConf) if schema is None else schema
    known = [str(key) for key in schema]
    for key in hydra:
        if prefix + str(key) == "hydra.env":  # Hydra's own, though its schema does not tell
            continue
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}"
            raise InputError(f"{prefix}{key}: there is no such key; {hint}")
        if OmegaConf.is_missing(schema, key) or OmegaConf.is_missing(hydra, key):
            continue
        if isinstance(schema._get_node(key), DictConfig) and OmegaConf.get_type(schema, key) is not dict:
            check_hydra(hydra[key], schema[key], f"{prefix}{key}.")
