"""A Panda that builds towers in PyBullet: imported only where it is chosen, as it needs `pip install "apf[panda]"`."""

try:
    from apf.panda.world import PandaWorld
except ModuleNotFoundError as error:
    if (error.name or "").startswith("apf"):
        raise
    raise ImportError(f"the robot world needs {error.name}: pip install 'apf[panda]'") from None

__all__ = ["PandaWorld"]
