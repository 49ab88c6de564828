"""A Panda that builds towers in PyBullet: imported only where it is chosen, as it needs `pip install "apf[panda]"`."""

from apf.worlds.panda.world import PandaWorld

__all__ = ["PandaWorld"]
