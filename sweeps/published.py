"""How the published code finds candidates, where the paper's text says other. For the sweep `published` alone."""

from collections.abc import Sequence

import numpy as np

from apf.acquisition import FeasiblePrefixExtensions, GreedyExtensions, Scorer, top
from apf.domain import Domain, Labelled, Scored
from apf.settings import settings
from apf.towers import TowerDomain, Towers
from apf.towers.rotations import ROTATIONS

PLACED = 0
"""The rotation of a block that keeps its sides: the identity is the first of `ROTATIONS`."""


@settings
class SharedBlockExtensions(GreedyExtensions):
    """Towers built one block at a time by a sampler with three faults, which greedy and random_ss share.

    The search starts from the best random towers of two blocks, and each length begins with the best towers of the
    length before. Every one of them gets the same share of `n` random next placements, and the best of all placements
    go on, whichever tower they are for. The faults:

    1. The candidates of a tower share the objects of the blocks, and a block has one pose. So all candidates that place
       the same block have the pose that was drawn last: 1,000 candidates hold as many different placements as there
       are blocks, 10. The copies count: the best ten candidates may be ten copies of one tower.
    2. Names of blocks are compared with numbers. So no block counts as used, and a tower may hold a block twice: of the
       candidates of three blocks, a fifth do.
    3. A placement is drawn for the sides of the turned block, but the block keeps its own sides. So it is not turned,
       and its offset is that of the block as it would have been; it may lie beside the block below.

    There the height of a block, too, is that of the turned block, and the quaternion that goes with it is one more
    input of the networks. Here both follow from the sides that the block keeps; neither decides whether a tower stands.
    """

    for_domain = TowerDomain

    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """As `Candidates.best`."""
        assert isinstance(domain, TowerDomain)
        found = top(n, [domain.random_plans(2, max(n, self.n), rng)], score)
        for _ in range(2, self.longest):
            share = max(1, -(-self.n // len(found)))
            pools = [shared_block_extensions(each.plan, share, domain, rng) for each in found]
            found = top(n, [domain.concatenate(pools)], score)
        return found


def shared_block_extensions(tower: Towers, n: int, domain: TowerDomain, rng: np.random.Generator) -> Towers:
    """A tower with one more placement, in n ways, with the three faults of `SharedBlockExtensions`.

    Args:
        tower: A batch of one, of K blocks.
        n: How many.
        domain: Of the tower.
        rng: The source of all draws.

    Returns:
        n towers of K + 1 blocks.
    """
    blocks = tower.blocks
    block, rotation = rng.integers(len(blocks), size=n), rng.integers(len(ROTATIONS), size=n)
    offset = domain.offset.draw(tower.dims[:, -1, :2] + blocks.dims_after(block, rotation)[:, :2], rng)
    last = np.zeros(len(blocks), int)
    np.maximum.at(last, block, np.arange(n))
    xy = tower.xy[:, -1] + offset[last[block]]
    return Towers(
        blocks,
        np.concatenate([tower.block.repeat(n, 0), block[:, None]], 1).astype(tower.block.dtype),
        np.concatenate([tower.rotation.repeat(n, 0), np.full((n, 1), PLACED)], 1).astype(tower.rotation.dtype),
        np.concatenate([tower.xy.repeat(n, 0), xy[:, None]], 1),
    )


@settings
class TurnedTowerExtensions(FeasiblePrefixExtensions):
    """One random block on a tower that stood as a whole, for incremental: all bases are equally likely.

    The bases are every block in each of its rotations, and each labelled tower that stood, as it was turned by 0, 90,
    180 and 270 degrees for training. So towers of few blocks are extended most at first, and later what there is most
    of. The published code draws from the towers that it trains on; here those held out are bases, too.
    """

    for_domain = TowerDomain

    def best(
        self, n: int, score: Scorer, domain: Domain, data: Sequence[Labelled], rng: np.random.Generator
    ) -> list[Scored]:
        """As `Candidates.best`."""
        assert isinstance(domain, TowerDomain)
        stood = [g.plans[(g.labels == 1).all(1)] for g in data if g.plans.length < self.longest]
        stood = [plans for plans in stood if len(plans)]
        bases = [turned_every_way(plans) for plans in stood]
        sizes = [len(domain.training_blocks) * len(ROTATIONS), *map(len, bases)]
        drawn = rng.multinomial(max(n, self.n), np.array(sizes) / sum(sizes))
        picks = [domain.random_plans(1, drawn[0], rng)]
        picks += [base[rng.integers(len(base), size=count)] for base, count in zip(bases, drawn[1:], strict=True)]
        return top(n, [domain.extend(pick, rng) for pick in picks if len(pick)], score)


def turned_every_way(towers: Towers) -> Towers:
    """[4 N] the towers turned by 0, 90, 180 and 270 degrees."""
    return Towers.concatenate([towers.turned(quarters) for quarters in range(4)])
