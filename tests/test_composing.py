"""Jobs of a sweep composed from one another are those that Hydra composes, each anew."""

from itertools import product

import pytest
from hydra import initialize_config_dir
from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from hydra.types import RunMode
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import DictConfig, OmegaConf

from apf.config.values import config_dir
from apf.launch.composing import Composer

FIXED = ["tracker=none", "hydra.sweep.dir=runs/x"]
VALUES = {
    "seed": ["0", "7", "-1", "null", "abc", "1e3", "${towers}"],
    "plans": ["100", "200"],
    "sampler": ["greedy", "sequential", "complete"],
    "world": ["noisy", "analytic"],
    "world.sd": ["0.1", "0.2"],
    "training.batch": ["4", "8", "${towers}"],
    "evaluation.lengths": ["[2]", "[2,3]", "[]"],
    "task": ["[tallest]", "[overhang,tallest]"],
    "execution": ["{time_limit:3}", "{time_limit:4}"],
    "execution.time_limit": ["null", "2.5"],
    "sweep": ["'a b'", '"its"', "a=b", "'x,y'"],
    "+training.extra": ["1", "2"],
    "++training.averaging": ["0.5", "0.9"],
    "training.averaging": ["0.6", "0.7"],
    "~training.patience": ["null"],
    "hydra.job.name": ["one", "two"],
    "nosuch": ["1", "2"],
    "model.nosuch": ["1", "2"],
}
"""What may be varied, and by which values; some of it is wrong, or clashes with the rest."""


@pytest.fixture(scope="module")
def loader() -> ConfigLoader:
    """Hydra's own."""
    with initialize_config_dir(config_dir(), version_base="1.3"):
        return GlobalHydra.instance().config_loader()


@pytest.fixture(scope="module")
def master(loader: ConfigLoader) -> DictConfig:
    """The config of the sweep."""
    return loader.load_configuration("config", [*FIXED, "seed=0,1"], RunMode.MULTIRUN, validate_sweep_overrides=False)


class Counting:
    """A loader that counts the jobs that it composes."""

    def __init__(self, loader: ConfigLoader) -> None:
        self.loader, self.count = loader, 0

    def load_sweep_config(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        self.count += 1
        return self.loader.load_sweep_config(master_config, sweep_overrides)

    def __getattr__(self, name: str) -> object:
        return getattr(self.loader, name)


def told(loader: ConfigLoader | Composer, master: DictConfig, overrides: list[str]) -> object:
    """All of a job's config, or what is said against it."""
    try:
        config = loader.load_sweep_config(master, overrides)
    except HydraException as error:
        return type(error), str(error), str(error.__cause__)
    return OmegaConf.to_container(config)


@given(
    keys=st.lists(st.sampled_from(sorted(VALUES)), min_size=1, max_size=4, unique=True),
    data=st.data(),
)
@settings(max_examples=15)
def test_it_gives_what_hydra_gives(
    loader: ConfigLoader, master: DictConfig, keys: list[str], data: st.DataObject
) -> None:
    composer = Composer(loader, master)
    for _ in range(3):
        overrides = ["tracker=none", *(f"{key}={data.draw(st.sampled_from(VALUES[key]))}" for key in keys)]
        assert told(composer, master, overrides) == told(loader, master, overrides), overrides


def test_jobs_that_differ_in_values_are_composed_once(loader: ConfigLoader, master: DictConfig) -> None:
    counting = Counting(loader)
    composer = Composer(counting, master)  # type: ignore[arg-type]
    for seed, batch, lengths in product(range(5), (4, 8), ("[2]", "[2,3]")):
        overrides = [f"seed={seed}", f"training.batch={batch}", f"evaluation.lengths={lengths}"]
        config = composer.load_sweep_config(master, overrides)
        assert (config.seed, config.training.batch) == (seed, batch)
        assert config.hydra.overrides.task == overrides
        assert config.hydra.job.override_dirname == ",".join(sorted(overrides))
    assert counting.count == 1


@pytest.mark.parametrize(
    ("overrides", "composed"),
    [
        (["sampler=greedy", "sampler=sequential", "sampler=greedy"], 2),  # a choice of a group
        (["execution={time_limit:1}", "execution={time_limit:2}"], 2),  # mappings are merged
        (["seed={a:1}", "seed={b:2}"], 2),
        (["+training.extra=1", "+training.extra=2"], 2),
        (["hydra.job.name=one", "hydra.job.name=two"], 2),
        (["execution.time_limit=1", "execution.time_limit=2", "execution.time_limit=null"], 1),
    ],
)
def test_what_is_composed_anew(loader: ConfigLoader, master: DictConfig, overrides: list[str], composed: int) -> None:
    counting = Counting(loader)
    composer = Composer(counting, master)  # type: ignore[arg-type]
    for override in overrides:
        assert told(composer, master, [override]) == told(loader, master, [override])
    assert counting.count == composed


def test_an_order_that_matters(loader: ConfigLoader, master: DictConfig) -> None:
    """What is set before the mapping that holds it, and what is set twice."""
    for rest in (["execution={time_limit:9}"], ["execution.time_limit=9"], ["++execution.time_limit=9"]):
        composer = Composer(loader, master)
        for limit in (1, 2):
            overrides = [f"execution.time_limit={limit}", *rest]
            assert told(composer, master, overrides) == told(loader, master, overrides)
            assert composer.load_sweep_config(master, overrides).execution.time_limit == 9


def test_a_mistake_leaves_the_next_job_as_it_is(loader: ConfigLoader, master: DictConfig) -> None:
    composer = Composer(loader, master)
    for overrides in (["seed=1", "sweep=a"], ["seed=${oops", "sweep=b"], ["seed=2", "sweep=c"]):
        assert told(composer, master, overrides) == told(loader, master, overrides)


def test_a_group_of_the_name_of_a_value(tmp_path_factory: pytest.TempPathFactory) -> None:
    """`size` is a value of the config, which the options of the group `size` set."""
    folder = tmp_path_factory.mktemp("conf")
    (folder / "size").mkdir()
    (folder / "config.yaml").write_text("defaults:\n  - size: small\n  - _self_\nseed: 0\n")
    for option, height in (("small", 1), ("big", 2)):
        text = f"# @package _global_\nsize: {option}\nheight: {height}\n"
        (folder / "size" / f"{option}.yaml").write_text(text)
    with initialize_config_dir(str(folder), version_base="1.3"):
        loader = GlobalHydra.instance().config_loader()
    master = loader.load_configuration("config", [], RunMode.MULTIRUN)
    composer = Composer(loader, master)
    for overrides in (["size=big"], ["size=small"], ["size=none"], ["seed=1"], ["seed=2"]):
        assert told(composer, master, overrides) == told(loader, master, overrides)
