"""A Panda that builds towers in PyBullet: imported only where it is chosen, as it needs `pip install "apf[panda]"`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from apf.panda.world import PandaWorld

__all__ = ["PandaWorld"]


def __getattr__(name: str) -> Any:
    """The world is imported when it is first asked for: the help of the robot's commands does not wait for it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from apf.panda.world import PandaWorld
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("apf"):
            raise
        raise ImportError(f"the robot world needs {error.name}: pip install 'apf[panda]'") from None
    return PandaWorld
