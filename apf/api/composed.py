"""Configs as Hydra composes them for a command, without Hydra's application around it."""

import contextlib
from collections.abc import Iterator, Sequence

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from apf.config.values import config_dir, without
from apf.errors import InputError
from apf.launch.cli import MISTAKES, find_modules_here, one_line
from apf.rundir.resume import quoted


@contextlib.contextmanager
def composed(name: str, overrides: Sequence[str]) -> Iterator[tuple[DictConfig, DictConfig]]:
    """Context: the config of a command, without Hydra's own part, and that part. Hydra's state is put back at the end.

    A user's mistake, here or in the context, becomes an InputError of one line.

    Args:
        name: Of the command's config in `conf/`.
        overrides: As on a command line.
    """
    kept = HydraConfig.instance().cfg
    try:
        find_modules_here()
        with initialize_config_dir(config_dir(), version_base="1.3"):
            whole = compose(name, [*overrides], return_hydra_config=True)
            HydraConfig.instance().set_config(whole)
            yield without(whole, "hydra"), whole.hydra
    except InputError:
        raise
    except MISTAKES as error:
        raise InputError(one_line(error)) from error
    finally:
        HydraConfig.instance().cfg = kept


def given(**values: object) -> list[str]:
    """Overrides for the values that are not None."""
    return [f"{key}={_typed(value)}" for key, value in values.items() if value is not None]


def _typed(value: object) -> str:
    return str(value) if isinstance(value, int | float) else quoted(str(value))
