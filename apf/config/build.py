"""From a composed config to checked objects."""

from typing import Any

import pydantic
from omegaconf import DictConfig, OmegaConf

from apf.config.messages import describe
from apf.config.parts import PartError, find, make
from apf.config.values import plain
from apf.errors import InputError


def build(cfg: DictConfig, schema: type) -> Any:
    """`schema` filled with what the config names, each class checked before any is called.

    Raises InputError, naming the key, for a class that does not fit its place, and for what is missing or wrong.
    """
    missing = sorted(OmegaConf.missing_keys(cfg))
    if missing:
        raise InputError(f"{missing[0]} is missing; give it as {missing[0]}=...")
    parts = find(plain(cfg), [schema])
    try:
        return schema(**make(parts))
    except pydantic.ValidationError as error:
        raise InputError(describe(error, "", cfg)) from None
    except PartError as error:
        cause = error.__cause__
        if isinstance(cause, pydantic.ValidationError):
            raise InputError(describe(cause, error.key, cfg)) from None
        if isinstance(cause, InputError):
            raise InputError(f"{error.key}: {cause}") from None
        reason = next(iter(str(cause).splitlines()), "")
        raise InputError(f"{error.key}: {type(cause).__name__}: {reason}") from cause
