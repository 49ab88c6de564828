"""Messages that the prefixes of a plan share.

A message between two placements does not depend on the prefix that holds them, so it is computed once. Each prefix then
sums the messages between its own placements.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import accumulate, chain, pairwise

import torch
from torch import Tensor
from torch.nn.functional import pad

Edges = list[list[tuple[int, int]]]
"""Groups of edges (source, target)."""


@dataclass(frozen=True, eq=False)
class SharedGraph:
    """The messages between all placements, and who receives which of them in each prefix.

    A node is a placement in a prefix. There are A edges, R prefixes, V nodes; the first L nodes receive messages.

    edge_index: [2, A] source and target of each edge; both are placements.
    additions: (into, of), ranges of edges. A node receives the same messages as in the shorter prefix, and the message
        from the new last placement. So all sums arise by adding messages to others in this order.
    sums: the range of L edges where the sums lie in the end.
    placement: [V] of each node. n_received: [V, 1, 1] the number of messages that each node receives.
    mean: [R, V] the matrix that averages over the nodes of each prefix.
    prefix: [V] 0..R - 1 of each node. share: [R, 1] of one node in the mean of its prefix.
    """

    edge_index: Tensor
    additions: tuple[tuple[slice, slice], ...]
    sums: slice
    placement: Tensor
    n_received: Tensor
    mean: Tensor
    prefix: Tensor
    share: Tensor

    def aggregate(self, messages: Tensor) -> Tensor:
        """Messages [E, A x N, H] -> sums [E, L x N, H]. The messages are overwritten."""
        by_edge = messages.view(len(messages), self.edge_index.shape[1], -1)
        for into, of in self.additions:
            by_edge[:, into] += by_edge[:, of]
        return by_edge[:, self.sums].reshape(len(messages), -1, messages.shape[2])

    def aggregate_vjp(self, gradient: Tensor) -> Tensor:
        """The gradient of the sums [E, L x N, H], which is overwritten -> of the messages [E, A x N, H]."""
        edges, sums = self.edge_index.shape[1], self.sums
        by_edge = gradient.view(len(gradient), sums.stop - sums.start, -1)
        if by_edge.shape[1] < edges:
            by_edge = pad(by_edge, (0, 0, sums.start, edges - sums.stop))
        for into, of in reversed(self.additions):
            by_edge[:, of] += by_edge[:, into]
        return by_edge.view(len(gradient), -1, gradient.shape[2])

    def means(self, nodes: Tensor) -> Tensor:
        """Nodes [E, V x N, H] -> the mean over each prefix [E, R x N, H], as one product."""
        by_node = nodes.view(len(nodes), len(self.prefix), -1)
        return torch.bmm(self.mean.expand(len(nodes), -1, -1), by_node).view(len(nodes), -1, nodes.shape[2])

    def means_vjp(self, gradient: Tensor) -> Tensor:
        """The gradient of the means [E, R x N, H] -> of the nodes [E, V x N, H]."""
        by_prefix = gradient.view(len(gradient), len(self.share), -1) * self.share
        return by_prefix.index_select(1, self.prefix).view(len(gradient), -1, gradient.shape[2])


@lru_cache(maxsize=256)
def shared_graph(length: int, both_ways: bool, last_only: bool, device: torch.device) -> SharedGraph:
    """The graph that the prefixes of a plan share; the arguments are those of `apf.models.graph.prefix_graph`.

    Args:
        length: K, the number of placements.
        both_ways: Edges between all pairs?
        last_only: For the whole plan alone?
        device: Where the tensors are to lie.
    """
    backward, forward = _edges(length, both_ways)
    of_backward, of_forward = _ranges(backward, 0), _ranges(forward, length * (length - 1) // 2)
    # nodes lie as the edges do whose messages they sum: by prefix, then the last placements of the prefixes
    last = [(source, source) for source in ([length - 1] if last_only else range(length - 1, 0, -1))]
    nodes = [(source + 1, target) for source, target in [*chain(*(backward[-1:] if last_only else backward)), *last]]
    prefixes = [length] if last_only else list(range(2, length + 1))
    number, index = (partial(torch.tensor, dtype=dtype, device=device) for dtype in (torch.float32, torch.long))
    with torch.inference_mode(False):  # the cache serves training as well as prediction
        return SharedGraph(
            edge_index=index(list(chain(*backward, *forward))).T,
            additions=tuple(_additions(of_backward, of_forward)),
            sums=slice(
                of_backward[-1].start if last_only else 0, of_backward[-1].stop + (len(last) if both_ways else 0)
            ),
            placement=index([placement for _, placement in nodes]),
            n_received=number([p - 1 - (0 if both_ways else placement) for p, placement in nodes]).reshape(-1, 1, 1),
            mean=number([[(prefix == p) / prefix for p, _ in nodes] for prefix in prefixes]),
            prefix=index([prefixes.index(prefix) for prefix, _ in nodes]),
            share=number([1 / prefix for prefix in prefixes]).reshape(-1, 1),
        )


def _edges(length: int, both_ways: bool) -> tuple[Edges, Edges]:
    """From each placement to those before it; and, if `both_ways`, from each to those after it, the last one first."""
    last = length - 1
    backward = [[(source, target) for target in range(source)] for source in range(1, length)]
    forward = [[(source, target) for target in range(last, source, -1)] for source in range(last)]
    return backward, forward if both_ways else []


def _ranges(groups: Edges, first: int) -> list[slice]:
    """The range of each group if the groups lie one after another, the first of them at `first`."""
    ends = accumulate(map(len, groups), initial=first)
    return [slice(start, end) for start, end in pairwise(ends)]


def _additions(backward: list[slice], forward: list[slice]) -> list[tuple[slice, slice]]:
    """`SharedGraph.additions`, given the ranges of edges from each placement: to those before it, to those after it."""
    additions = []
    for more in forward[1:]:  # the first range collects what the last placement of each prefix receives
        additions.append((slice(forward[0].start, forward[0].start + more.stop - more.start), more))
    for shorter, longer in pairwise(backward):  # one placement more: the last of the shorter prefix
        additions.append((slice(longer.start, longer.stop - 1), shorter))
        if forward:
            received = forward[0].stop - (shorter.stop - shorter.start)
            additions.append((slice(longer.stop - 1, longer.stop), slice(received, received + 1)))
    return additions
