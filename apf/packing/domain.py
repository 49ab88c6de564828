"""Packing boxes as a domain of plans, in the four parts of the appendix (Method Generalizability).

Action definitions: `apf.packing.boxes`, `packings`, `random_packings`. Experimental infrastructure:
`apf.packing.worlds`, `files`. Feasibility detector: `apf.packing.rule`. Inductive bias: `apf.packing.features`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from apf.domain import Domain, NamedPlans
from apf.errors import InputError
from apf.packing.balanced import balanced_packings
from apf.packing.boxes import ORIENTATIONS, BoxSet
from apf.packing.features import N_FEATURES, N_POSITION, features, views
from apf.packing.files import packing_table, read_boxes, read_packings, write_boxes
from apf.packing.packings import Cell, Container, Gripper, Packings
from apf.packing.random_packings import Places, random_extensions, random_packings
from apf.packing.rule import packed
from apf.packing.sources import BoxSource
from apf.packing.variations import variations
from apf.settings import Number, Switch, settings

APART = 0.25
"""From so much on, two places of a box are no variations of each other, in units of its sides."""


@settings
class PackingDomain(Domain):
    """A container, a gripper, box sets for experiments and for evaluation, and the plans that can be made of them."""

    container: Container = Field(default_factory=Container)
    gripper: Gripper = Field(default_factory=Gripper)
    training: BoxSource = Field(default_factory=BoxSource)
    """Boxes that the robot experiments with."""
    evaluation: BoxSource = Field(default_factory=BoxSource)
    """Other boxes, for every evaluation."""
    choice: Annotated[Number, Field(ge=1, le=100)] = 2.0
    """A planning problem has so many times the boxes that a plan packs, as far as there are: which to pack is a part
    of it."""
    places: Places = Field(default_factory=Places)
    symmetry: Switch = True
    """Train on the mirror images of a packing, too?"""

    n_features = N_FEATURES
    n_position = N_POSITION
    plan_word = "packing"
    object_word = "box"
    object_files = ("training_boxes.csv", "evaluation_boxes.csv")

    @cached_property
    def cell(self) -> Cell:
        """Container and gripper, which every plan carries."""
        return Cell(self.container, self.gripper)

    @cached_property
    def training_boxes(self) -> BoxSet:
        """The set that the robot experiments with."""
        return self._loaded("training", self.training)

    @cached_property
    def evaluation_boxes(self) -> BoxSet:
        """The novel set."""
        return self._loaded("evaluation", self.evaluation)

    def _loaded(self, which: str, source: BoxSource) -> BoxSet:
        """The boxes, each of which must fit into the container by itself, however it is turned."""
        try:
            boxes = source.load()
        except InputError as error:
            raise InputError(f"domain.{which}.file: {error}") from None
        b, n = len(boxes), len(ORIENTATIONS)
        box, orientation = np.repeat(np.arange(b), n), np.tile(np.arange(n), b)
        alone = Packings(self.cell, boxes, box[:, None], orientation[:, None], np.zeros((b * n, 1, 2)))
        reach = self.places.reach(self.cell, alone.dims[:, 0, :2], alone.grip[:, 0]) + self.places.room
        bad = ~packed(alone) | (reach > self.container.half).any(1)
        if bad.any():
            i = int(np.argmax(bad))
            sides = " x ".join(f"{side:g}" for side in alone.dims[i, 0])
            raise InputError(
                f"domain.{which}: box {boxes.name[box[i]]} in orientation {ORIENTATIONS[orientation[i]]}, {sides} m, "
                "does not fit into domain.container with domain.gripper and domain.places.room; a first box must"
            )
        return boxes

    def check_length(self, length: int, key: str, evaluation: bool = False) -> None:
        """As `Domain.check_length`: there must be as many boxes."""
        which, boxes = ("evaluation", self.evaluation_boxes) if evaluation else ("training", self.training_boxes)
        if length > len(boxes):
            raise InputError(f"{key}: packings of {length} boxes need {length} boxes; domain.{which} has {len(boxes)}")

    def random_plans(self, length: int, n: int, rng: np.random.Generator) -> Packings:
        """As `Domain.random_plans`: packings of training boxes."""
        return random_packings(self.cell, self.training_boxes, length, n, rng, self.places)

    def extend(self, plans: Packings, rng: np.random.Generator) -> Packings:
        """Each plan with one more random placement."""
        return random_extensions(plans, rng, self.places)

    def vary(self, plans: Packings, rng: np.random.Generator) -> Packings:
        """As `Domain.vary`. Which boxes are packed varies, too."""
        return variations(plans, rng, self.places)

    def concatenate(self, parts: Sequence[Packings]) -> Packings:
        """All plans of the parts, which have one length."""
        return Packings.concatenate(parts)

    def differ(self, plans: Packings, plan: Packings) -> np.ndarray:
        """As `Domain.differ`: other boxes, another order, a box turned, or elsewhere by more than `APART`."""
        elsewhere = (np.abs(plans.xy - plan.xy) > APART * plan.dims[..., :2]).any((1, 2))
        return (plans.box != plan.box).any(1) | (plans.dims != plan.dims).any((1, 2)) | elsewhere

    def feasible(self, plans: Packings) -> np.ndarray:
        """[N] bool: would the plan succeed in a world without noise?"""
        return packed(plans)

    def features(self, plans: Packings) -> np.ndarray:
        """[N, K, n_features] float32: what a network sees."""
        return features(plans)

    def views(self, plans: Packings) -> Iterator[np.ndarray]:
        """Features of plans that have the same labels, their own first; those alone without `symmetry`."""
        return views(plans) if self.symmetry else iter([features(plans)])

    def problem(self, length: int, candidates: int, rng: np.random.Generator, evaluation: bool = True) -> Packings:
        """As `Domain.problem`: all candidates choose from the same boxes."""
        boxes = self._set(evaluation)
        chosen = rng.choice(len(boxes), min(round(self.choice * length), len(boxes)), replace=False)
        return random_packings(self.cell, boxes.subset(chosen), length, candidates, rng, self.places)

    def balanced(self, length: int, n: int, rng: np.random.Generator) -> tuple[Packings, np.ndarray]:
        """As `Domain.balanced`: packings of evaluation boxes."""
        return balanced_packings(self.cell, self.evaluation_boxes, length, n, rng, self.places)

    def encode(self, plans: Packings, evaluation: bool = False) -> list[dict[str, Any]]:
        """As `Domain.encode`: boxes by their numbers in the whole set."""
        number = {name: i for i, name in enumerate(self._set(evaluation).name)}
        box = np.array([number[name] for name in plans.boxes.name])[plans.box]
        columns = (box.tolist(), plans.orientation.tolist(), plans.xy.tolist())
        return [{"box": b, "orientation": o, "xy": xy} for b, o, xy in zip(*columns, strict=True)]

    def encoded_length(self, plan: dict[str, Any], evaluation: bool = False) -> int:
        """As `Domain.encoded_length`."""
        n = len(self._set(evaluation))
        match plan:
            case {"box": [*box], "orientation": [*turn], "xy": [*xy]} if len(box) == len(turn) == len(xy) > 0:
                numbers = all(type(b) is int and 0 <= b < n for b in box)
                turns = all(type(o) is int and 0 <= o < len(ORIENTATIONS) for o in turn)
                if numbers and turns and len(set(box)) == len(box):
                    return len(box)
        raise ValueError(f"a plan is not box (0 to {n - 1}), orientation and xy of some placements")

    def decode(self, plans: Sequence[dict[str, Any]], evaluation: bool = False) -> Packings:
        """As `Domain.decode`."""
        box = np.array([plan["box"] for plan in plans], np.int16)
        orientation = np.array([plan["orientation"] for plan in plans], np.int8)
        xy = np.array([plan["xy"] for plan in plans], float)
        return Packings(self.cell, self._set(evaluation), box, orientation, xy)

    def _set(self, evaluation: bool) -> BoxSet:
        return self.evaluation_boxes if evaluation else self.training_boxes

    def table(self, plans: Packings) -> pd.DataFrame:
        """One row per placement, in the columns of a packing file."""
        return packing_table(plans)

    def save_picture(self, plan: Packings, path: Path, title: str = "") -> bool:
        """As `Domain.save_picture`."""
        from apf.packing.picture import save_picture

        save_picture(plan, path)
        return True

    def read_plans(self, path: Path, objects: BoxSet | None = None) -> list[NamedPlans]:
        """The packings of a packing file, in this domain's container."""
        return read_packings(path, self.cell, objects)

    @cached_property
    def objects(self) -> dict[str, BoxSet]:
        """Both box sets."""
        return dict(zip(self.object_files, (self.training_boxes, self.evaluation_boxes), strict=True))

    def read_objects(self, path: Path) -> BoxSet:
        """A box set of a run directory."""
        return read_boxes(path)

    def write_objects(self, objects: BoxSet, path: Path) -> None:
        """A box file with its units in the header."""
        write_boxes(objects, path, units=True)

    def kept_in(self, directory: Path) -> "PackingDomain":
        """This domain with the box sets that `keep` wrote into a directory, wherever they came from at first."""
        training, evaluation = (directory / name for name in self.object_files)
        return replace(
            self,
            training=replace(self.training, file=training),
            evaluation=replace(self.evaluation, file=evaluation),
        )
