"""The graph that the prefixes of a plan share: who hears from whom in which prefix."""

from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import accumulate, chain, pairwise

import torch
from torch import Tensor
from torch.nn.functional import pad


@dataclass(frozen=True, eq=False)
class PrefixGraph:
    """Which messages each block of each prefix receives.

    A slot is a block in a prefix; P edges, S slots, of which the first L hear from others, R prefixes.

    edges: [2, P] (source, target).
    additions: (into, of), ranges of edges. A block hears what it does in the prefix before, and its new top: adding
        messages to others, in this order, makes all sums.
    hear: the range of L edges that hold these sums in the end.
    block: [S] the block of each slot. n_received: [S, 1, 1] how many messages it receives.
    mean: [R, S] averages over slots. prefix: [S] the prefix of each slot. share: [R, 1] of a slot in its prefix.
    """

    edges: Tensor
    additions: tuple[tuple[slice, slice], ...]
    hear: slice
    block: Tensor
    n_received: Tensor
    mean: Tensor
    prefix: Tensor
    share: Tensor

    def received(self, messages: Tensor) -> Tensor:
        """[E, P x N, H] -> [E, L x N, H]: the sums that slots receive. Messages are added up where they lie."""
        by_edge = messages.view(len(messages), self.edges.shape[1], -1)
        for into, of in self.additions:
            by_edge[:, into] += by_edge[:, of]
        return by_edge[:, self.hear].reshape(len(messages), -1, messages.shape[2])

    def received_vjp(self, gradient: Tensor) -> Tensor:
        """[E, L x N, H] -> [E, P x N, H]: the gradient of messages from that of sums, which changes."""
        edges, hear = self.edges.shape[1], self.hear
        by_edge = gradient.view(len(gradient), hear.stop - hear.start, -1)
        if by_edge.shape[1] < edges:
            by_edge = pad(by_edge, (0, 0, hear.start, edges - hear.stop))
        for into, of in reversed(self.additions):
            by_edge[:, of] += by_edge[:, into]
        return by_edge.view(len(gradient), -1, gradient.shape[2])

    def means(self, slots: Tensor) -> Tensor:
        """[E, S x N, H] -> [E, R x N, H]: averages over the slots of each prefix, as one product."""
        by_slot = slots.view(len(slots), len(self.prefix), -1)
        return torch.bmm(self.mean.expand(len(slots), -1, -1), by_slot).view(len(slots), -1, slots.shape[2])

    def means_vjp(self, gradient: Tensor) -> Tensor:
        """[E, R x N, H] -> [E, S x N, H]: the gradient of slots from that of averages."""
        by_prefix = gradient.view(len(gradient), len(self.share), -1) * self.share
        return by_prefix.index_select(1, self.prefix).view(len(gradient), -1, gradient.shape[2])


@lru_cache(maxsize=256)
def prefix_graph(length: int, both_ways: bool, whole: bool, device: torch.device) -> PrefixGraph:
    """The graph of plans of `length` placements, for prefixes 2..length, or for the whole plan alone.

    Edges run from every block above to each below it, or `both_ways` between all pairs.
    """
    top = length - 1
    down = [[(source, target) for target in range(source)] for source in range(1, length)]
    up = [[(source, target) for target in range(top, source, -1)] for source in range(top)] if both_ways else []
    of_down, of_up = _ranges(down, 0), _ranges(up, length * top // 2)
    additions = []
    for new in of_up[1:]:  # the first of these ranges is to hold what each top hears, the highest first
        additions.append((slice(of_up[0].start, of_up[0].start + new.stop - new.start), new))
    for before, new in pairwise(of_down):  # one block more, the top of the prefix before, hears the new top
        additions.append((slice(new.start, new.stop - 1), before))
        if both_ways:
            heard = of_up[0].stop - (before.stop - before.start)
            additions.append((slice(new.stop - 1, new.stop), slice(heard, heard + 1)))
    blocks = [(source, block) for group in (down[-1:] if whole else down) for source, block in group]
    tops = [(source, source) for source in ([top] if whole else range(top, 0, -1))]
    slots = [(source + 1, block) for source, block in blocks + tops]
    prefixes = [length] if whole else list(range(2, length + 1))
    mean = [[(prefix == p) / prefix for p, _ in slots] for prefix in prefixes]
    with torch.inference_mode(False):  # cached: training must be able to use what prediction made first
        number = partial(torch.tensor, dtype=torch.float32, device=device)
        index = partial(torch.tensor, device=device)
        return PrefixGraph(
            edges=index(list(chain(*down, *up))).T,
            additions=tuple(additions),
            hear=slice(of_down[-1].start if whole else 0, of_down[-1].stop + (len(tops) if both_ways else 0)),
            block=index([block for _, block in slots]),
            n_received=number([prefix - 1 - (0 if both_ways else block) for prefix, block in slots]).reshape(-1, 1, 1),
            mean=number(mean),
            prefix=index([prefixes.index(prefix) for prefix, _ in slots]),
            share=number([1 / prefix for prefix in prefixes]).reshape(-1, 1),
        )


def _ranges(groups: list[list[tuple[int, int]]], first: int) -> list[slice]:
    """Where each group lies if they lie one after another, the first one here."""
    ends = accumulate(map(len, groups), initial=first)
    return [slice(start, end) for start, end in pairwise(ends)]
