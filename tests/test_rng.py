import itertools

import pytest
import torch

from apf.rng import stream, torch_generator


def start(*name):
    return stream(*name).integers(2**62)


def test_a_name_fixes_its_stream():
    assert (stream(3, "world", 1, 2).random(100) == stream(3, "world", 1, 2).random(100)).all()


def test_streams_of_other_names_or_counters_differ():
    names = [
        *itertools.product((0, 1, 2**40), ("world", "train", ""), (0, 1, 2), (0, 1)),
        *itertools.product((0, 1, 2**40), ("world", "train", ""), (1, 2)),
    ]
    assert len({start(*name) for name in names}) == len(names)


@pytest.mark.parametrize("counters", [(1,), (1, 0)])
def test_a_further_counter_of_zero_makes_another_stream(counters):
    assert start(0, "world", *counters) != start(0, "world", *counters, 0)


def test_streams_are_the_same_everywhere():
    # pinned: to change it changes every result
    assert start(0, "world", 1) == 2224110881352266073


def test_torch_generators_follow_the_stream():
    rng = stream(0, "train")
    first, second = (torch.rand(5, generator=torch_generator(rng)) for _ in range(2))
    again = torch.rand(5, generator=torch_generator(stream(0, "train")))
    assert torch.equal(first, again)
    assert not torch.equal(first, second)
