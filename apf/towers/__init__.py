"""The stacking domain: blocks, towers, rotations, the analytic rule, features and files."""

from apf.towers.balanced import balanced_towers
from apf.towers.blocks import BlockSet
from apf.towers.domain import TowerDomain
from apf.towers.features import N_FEATURES, N_POSITION, features
from apf.towers.files import read_blocks, read_towers, write_blocks, write_towers
from apf.towers.predictors import AnalyticPredictor, SimulationPredictor
from apf.towers.rotations import QUATERNIONS, ROTATIONS, rotation_index
from apf.towers.sources import BlockSource
from apf.towers.stability import standing_prefixes, stands
from apf.towers.tasks import Overhang, Tallest, Unsupported
from apf.towers.towers import Offset, Towers, random_extensions, random_towers
from apf.towers.worlds import AnalyticWorld, NoisyWorld

__all__ = [
    "N_FEATURES",
    "N_POSITION",
    "QUATERNIONS",
    "ROTATIONS",
    "AnalyticPredictor",
    "AnalyticWorld",
    "BlockSet",
    "BlockSource",
    "NoisyWorld",
    "Offset",
    "Overhang",
    "SimulationPredictor",
    "Tallest",
    "TowerDomain",
    "Towers",
    "Unsupported",
    "balanced_towers",
    "features",
    "random_extensions",
    "random_towers",
    "read_blocks",
    "read_towers",
    "rotation_index",
    "standing_prefixes",
    "stands",
    "write_blocks",
    "write_towers",
]
