"""The boundary: what a domain of plans brings, and all that the rest of the package knows of it."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import pandas as pd

from apf.domain.plans import NamedPlans
from apf.errors import InputError


class Objects(Protocol):
    """The objects that plans are made of."""

    @property
    def digest(self) -> str:
        """Digits that tell these objects from all others."""
        ...

    def equals(self, other: Any) -> bool:
        """Are these the same objects, number for number?"""
        ...


class Domain(ABC):
    """A domain of plans (appendix, Method Generalizability): action definitions, and what follows from them.

    A batch of N plans of K placements is an object of the domain's own class, which offers `Plans`. A sub-class is a
    dataclass made by `apf.settings.settings`: its fields are the keys of its config. Besides this class a domain brings
    worlds (`apf.domain.World`, the experimental infrastructure and the feasibility detector), tasks (`apf.domain.Task`)
    and predictors that know the rule (`apf.domain.Predictor`). The inductive bias is in `features` and `views`, and in
    the network that `conf/model` chooses.
    """

    n_features: ClassVar[int]
    """F: numbers that a network sees of each placement."""
    plan_word: ClassVar[str] = "plan"
    """What a plan is called in tables and figures."""
    object_word: ClassVar[str] = "placement"
    """What its objects are called."""
    object_files: ClassVar[tuple[str, ...]] = ()
    """Names of the files in which a run directory keeps the objects of its plans."""

    @property
    @abstractmethod
    def n_position(self) -> int:
        """D: how many of the features, the last ones, are a position, of which graph networks see differences alone.

        0: there is none; positions, if there are any, are features like others.
        """

    # -- action definitions -------------------------------------------------------------------------------------

    @abstractmethod
    def check_length(self, length: int, key: str, evaluation: bool = False) -> None:
        """Refuse a length of which there are no plans.

        Args:
            length: Placements of a plan.
            key: The config key that asks for this length.
            evaluation: Are the plans made of the objects of the evaluation, or of those of the experiment?

        Raises:
            InputError: No such plan can be made; it names the key.
        """

    @abstractmethod
    def random_plans(self, length: int, n: int, rng: np.random.Generator) -> Any:
        """Random plans of the objects of the experiment.

        Args:
            length: Placements of each plan.
            n: How many plans.
            rng: The source of all draws.
        """

    @abstractmethod
    def extend(self, plans: Any, rng: np.random.Generator) -> Any:
        """Each plan with one more random placement."""

    @abstractmethod
    def vary(self, plans: Any, rng: np.random.Generator) -> Any:
        """One variation of each plan, for a planner that searches: something of the plan is changed, much or a little.

        Args:
            plans: N plans of K placements.
            rng: The source of all draws.

        Returns:
            N plans of K placements, of the objects that the plans' set has. Repeated variations reach any plan.
        """

    @abstractmethod
    def concatenate(self, parts: Sequence[Any]) -> Any:
        """All plans of the parts, which have one length."""

    def differ(self, plans: Any, plan: Any) -> np.ndarray:
        """[N] bool: is each plan another one in the eyes of a person, and not just a variation?

        By default, all but the very same plan are others. A domain may ask for more, such as other objects, another
        order, or a pose that is apart by a share of an object's size.

        Args:
            plans: N plans of K placements.
            plan: A batch of one, of K placements of the same set of objects.
        """
        (this,) = self.encode(plan)
        return np.array([each != this for each in self.encode(plans)], bool)

    # -- feasibility detector -----------------------------------------------------------------------------------

    @abstractmethod
    def feasible(self, plans: Any) -> np.ndarray:
        """[N] bool: would the plan succeed in a world without noise?"""

    # -- inductive bias -----------------------------------------------------------------------------------------

    @abstractmethod
    def features(self, plans: Any) -> np.ndarray:
        """[N, K, F] float32: what a network sees, of about unit range."""

    def views(self, plans: Any) -> Iterable[np.ndarray]:
        """Features [N, K, F] of plans that have the same labels as these, one batch after another.

        Symmetries of the domain, such as mirror images. By default the plans' own features alone.
        """
        yield self.features(plans)

    # -- evaluation ---------------------------------------------------------------------------------------------

    @abstractmethod
    def problem(self, length: int, candidates: int, rng: np.random.Generator, evaluation: bool = True) -> Any:
        """A planning problem: random plans, the candidates of a planner.

        Some objects are drawn first; all candidates are made of these.

        Args:
            length: Placements of each plan.
            candidates: How many plans.
            rng: The source of all draws.
            evaluation: Are the plans made of the objects of the evaluation, or of those of the experiment?
        """

    @abstractmethod
    def balanced(self, length: int, n: int, rng: np.random.Generator) -> tuple[Any, np.ndarray]:
        """A balanced test set, of objects of the evaluation.

        Args:
            length: Placements of each plan.
            n: How many plans.
            rng: The source of all draws.

        Returns:
            The plans, and whether each is feasible [n] bool; half of the plans are.
        """

    # -- on disk ------------------------------------------------------------------------------------------------

    @abstractmethod
    def encode(self, plans: Any, evaluation: bool = False) -> list[dict[str, Any]]:
        """Each plan as what JSON can hold; `decode` gives the same plan bit for bit.

        Args:
            plans: N plans of one length.
            evaluation: Are the plans made of the objects of the evaluation, or of those of the experiment?
        """

    @abstractmethod
    def encoded_length(self, plan: dict[str, Any], evaluation: bool = False) -> int:
        """How many placements a plan has that `encode` wrote, as `encode` was told of its objects.

        Raises:
            ValueError: It is no plan of this domain.
        """

    @abstractmethod
    def decode(self, plans: Sequence[dict[str, Any]], evaluation: bool = False) -> Any:
        """The plans, all of one length, that `encode` wrote, as `encode` was told of their objects."""

    @abstractmethod
    def table(self, plans: Any) -> pd.DataFrame:
        """[N x K rows] one row per placement, plan by plan, in the columns of the domain's files.

        The first column, named `plan_word`, counts plans from 0, the second, `position`, placements from 0.
        """

    @abstractmethod
    def read_plans(self, path: Path, objects: Any = None) -> list[NamedPlans]:
        """The plans of somebody's own file, one batch for each length.

        Args:
            path: A .csv or .parquet file in the columns of `table`.
            objects: The objects that the file names, as `read_objects` gives them; None: the file itself tells their
                properties.

        Raises:
            InputError: Something is wrong with the file; it names file and row.
        """

    def save_picture(self, plan: Any, path: Path, title: str = "") -> bool:
        """Write a picture of one plan; False, and no file: the domain draws none, as by default.

        Args:
            plan: A batch of one.
            path: Of the file: .png, .svg or .pdf.
            title: Of the picture.
        """
        return False

    @property
    @abstractmethod
    def objects(self) -> Mapping[str, Objects]:
        """The objects that plans are made of, by the names of `object_files`."""

    @abstractmethod
    def read_objects(self, path: Path) -> Objects:
        """The objects that `write_objects` wrote. Raises InputError if the file is damaged."""

    @abstractmethod
    def write_objects(self, objects: Any, path: Path) -> None:
        """Write objects so that `read_objects` gives the same, number for number."""

    @abstractmethod
    def kept_in(self, directory: Path) -> Self:
        """This domain with the objects that `keep` wrote into a directory, wherever they came from at first."""

    @property
    def digests(self) -> dict[str, str]:
        """By the name of its file, digits that tell each set of objects from all others."""
        return {name: objects.digest for name, objects in self.objects.items()}

    def keep(self, directory: Path) -> None:
        """Write all objects into a run directory, unless they are there: what was labelled stays tied to them."""
        for name, objects in self.objects.items():
            if not self.is_kept(directory / name):
                self.write_objects(objects, directory / name)

    def is_kept(self, path: Path) -> bool:
        """Is there such a file, and does it hold what `keep` writes there?"""
        try:
            return path.exists() and self.objects[path.name].equals(self.read_objects(path))
        except InputError:
            return False

    def check_kept(self, directory: Path) -> None:
        """Raises InputError if objects are not those that `keep` wrote."""
        for name, objects in self.objects.items():
            path = directory / name
            content = path.read_bytes() if path.is_file() else b""
            if (name, content) in self._found:
                continue
            if not objects.equals(self.read_objects(path)):
                raise InputError(f"{path} differs from the config; labels belong to what is there")
            self._found.add((name, content))

    @cached_property
    def _found(self) -> set[tuple[str, bytes]]:
        """Files, by name and content, that were found to hold these objects: the runs of a sweep have the same."""
        return set()
