"""The packing domain: boxes that a gripper packs from above into a container (appendix, Method Generalizability)."""

from apf.packing.boxes import ORIENTATIONS, BoxSet
from apf.packing.domain import PackingDomain
from apf.packing.files import read_boxes, read_packings, write_boxes, write_packings
from apf.packing.packings import Cell, Container, Gripper, Packings
from apf.packing.predictors import AnalyticPredictor, SimulationPredictor
from apf.packing.random_packings import Places, random_extensions, random_packings
from apf.packing.rule import Failure, failures, packed, packed_prefixes
from apf.packing.sources import BoxSource
from apf.packing.tasks import Flat, Value, Volume
from apf.packing.worlds import AnalyticWorld, NoisyWorld

__all__ = [
    "ORIENTATIONS",
    "AnalyticPredictor",
    "AnalyticWorld",
    "BoxSet",
    "BoxSource",
    "Cell",
    "Container",
    "Failure",
    "Flat",
    "Gripper",
    "NoisyWorld",
    "PackingDomain",
    "Packings",
    "Places",
    "SimulationPredictor",
    "Value",
    "Volume",
    "failures",
    "packed",
    "packed_prefixes",
    "random_extensions",
    "random_packings",
    "read_boxes",
    "read_packings",
    "write_boxes",
    "write_packings",
]
