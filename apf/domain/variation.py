"""What variations of plans have in common, whatever the plans are made of."""

import numpy as np


def exchanged(objects: np.ndarray, place: np.ndarray, b: int, rng: np.random.Generator) -> np.ndarray:
    """Each plan with another object at one place; if the plan holds that object already, the two change places.

    Args:
        objects: [N, K] the objects of N plans, by number. No plan holds an object twice.
        place: [N] where the other object comes.
        b: How many objects there are: numbers are below b.
        rng: The source of all draws.

    Returns:
        [N, K] the objects; no plan holds one twice.
    """
    if b == 1:
        return objects
    old = np.take_along_axis(objects, place[:, None], axis=1)
    new = another(old, b, rng)
    return np.where(objects == new, old, np.where(objects == old, new, objects))


def swapped(n: int, k: int, rng: np.random.Generator) -> np.ndarray:
    """Orders in which two placements have changed places.

    Args:
        n: How many plans.
        k: Placements of each plan.
        rng: The source of all draws.

    Returns:
        [n, k] the order of each plan: numbers of placements.
    """
    order = np.tile(np.arange(k), (n, 1))
    return exchanged(order, rng.integers(k, size=(n,)), k, rng)


def another(numbers: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Other numbers than these, each with the same chance.

    Args:
        numbers: Any array of numbers from 0 to n - 1.
        n: Of numbers that there are; 2 or more.
        rng: The source of all draws.
    """
    return ((numbers + rng.integers(1, n, numbers.shape)) % n).astype(numbers.dtype)


def step_sizes(n: int, bounds: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """[n] sizes of steps, uniform on a logarithmic scale: large steps explore, small steps refine.

    Args:
        n: How many.
        bounds: The smallest and the largest size.
        rng: The source of all draws.
    """
    low, high = np.log(bounds)
    return np.exp(rng.uniform(low, high, n))
