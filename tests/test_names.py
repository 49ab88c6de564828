"""Names and colours of groups of runs in figures."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apf.report.names import COLOURS, OPTIONS, colours_of, in_order, name_of, world_of


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("sequential", "Sequential"),
        ("random_ss, tgn", "Random, by prefix; TGN"),
        ("greedy, training.patience=null", "Greedy; training.patience=null"),
        ("my_own", "my_own"),
    ],
)
def test_names_for_people(label: str, name: str) -> None:
    assert name_of(label) == name


def test_worlds_in_words() -> None:
    assert [world_of(name) for name in ("analytic", "noisy", "mine")] == [
        "placed without noise",
        "placed with noise",
        "world mine",
    ]


def test_options_of_a_group_differ_in_colour() -> None:
    samplers = ["sequential", "incremental", "complete", "greedy", "search", "random_ss", "random_comp"]
    models = ["tgn", "fcgn", "lstm", "tgn_contact"]
    for names in (samplers, models, ["learned", "analytic", "simulation"], ["analytic", "noisy", "panda"]):
        assert len({OPTIONS[name][1] for name in names}) == len(names)


def test_an_option_keeps_its_colour_in_any_company() -> None:
    for one, other in itertools.permutations(["sequential", "greedy", "mine", "random_ss"], 2):
        for name in (one, other):
            if name in OPTIONS:
                assert colours_of([one, other])[name] == OPTIONS[name][1]


def test_of_two_options_the_one_that_differs_gives_the_colour() -> None:
    assert colours_of(["sequential, lstm", "sequential, tgn"]) == {
        "sequential, lstm": OPTIONS["lstm"][1],
        "sequential, tgn": OPTIONS["tgn"][1],
    }


@given(st.lists(st.text("abc=, ", min_size=1) | st.sampled_from([*OPTIONS]), max_size=len(COLOURS), unique=True))
def test_colours_differ_whatever_the_labels_and_their_order(labels: list[str]) -> None:
    found = colours_of(labels)
    assert list(found) == labels
    assert found == {label: colours_of(labels[::-1])[label] for label in labels}
    if not set(labels) & set(OPTIONS):
        assert len(set(found.values())) == len(labels)


def test_order() -> None:
    assert in_order(["mine", "random_ss, lstm", "greedy", "sequential", "another"]) == [
        "sequential",
        "greedy",
        "random_ss, lstm",
        "mine",
        "another",
    ]
