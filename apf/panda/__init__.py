"""A Panda that builds towers in PyBullet: imported only where it is chosen, as it needs `pip install "apf[panda]"`."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from apf.errors import InputError

if TYPE_CHECKING:
    from apf.panda.world import PandaWorld

__all__ = ["PandaWorld"]


def __getattr__(name: str) -> Any:
    """The world is imported when it is first asked for: the help of the robot's commands does not wait for it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with needs_extra("the robot world", ImportError):
        from apf.panda.world import PandaWorld
    return PandaWorld


@contextmanager
def needs_extra(what: str, kind: type[Exception] = InputError) -> Iterator[None]:
    """Meanwhile, a package that is not installed is an error of one line, which names the extra.

    Args:
        what: Needs the package.
        kind: Of the error.

    Raises:
        Exception: Of that kind.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("apf"):
            raise
        raise kind(f"{what} needs {error.name}: pip install 'apf[panda]'") from None
