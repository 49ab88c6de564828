"""Graph networks over the blocks of a tower: TGN and FCGN (Section Learning; Fig. architectures).

A prediction for every prefix of a plan comes from one pass. The message between two blocks does not depend on the
prefix that holds them, so each is computed once; a prefix then sums those whose blocks it holds.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from pydantic import PositiveInt, validate_call
from torch import Tensor

from apf.imports import put_off
from apf.models.graph_vjp import written_out
from apf.models.layers import VJP, EnsembleLinear, EnsembleNetwork, affine
from apf.models.prefixes import PrefixGraph, prefix_graph
from apf.settings import Few, Width

with put_off("torch._dynamo"):  # the compiler: two of five seconds of a start
    from torch_geometric.nn import MessagePassing


class PrefixMessages(MessagePassing):
    """Messages along the edges of a `PrefixGraph`, summed for every slot, all but their last layer.

    A message is a net of three layers on both blocks' own features and on where the source lies, seen from the target.
    """

    def __init__(self, members: int, n_own: int, n_position: int, hidden: int) -> None:
        super().__init__(aggr="sum", node_dim=-3)
        self.first = EnsembleLinear(members, 2 * n_own + n_position + 1, hidden, last_is_one=True)
        self.middle = EnsembleLinear(members, hidden, hidden)

    def forward(self, pairs: Tensor, graph: PrefixGraph) -> Tensor:
        """Features of all pairs [E, P x N, 2 (F - D) + D + 1] -> [E, L x N, H]: what each slot receives."""
        return self.propagate(graph.edges, pairs=pairs, graph=graph)

    def message(self, pairs: Tensor) -> Tensor:
        """Features of all pairs -> [E, P x N, H]."""
        return self.middle(self.first(pairs, relu=True), relu=True)

    def aggregate(self, inputs: Tensor, graph: PrefixGraph) -> Tensor:
        """[E, P x N, H] -> [E, L x N, H]: sums over the edges into each slot."""
        return graph.received(inputs.clone() if inputs.requires_grad else inputs)


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is known of N plans before any weight: features side by side for each edge and slot.

    E is 1 where all members are shown the same plans. D of the F features are a position.
    pairs: [E, P x N, 2 (F - D) + D + 1] of source, target, where the one lies, seen from the other, and 1.
    slots: [E, S x N, F - D + 2] of the block, 1, and how many messages it receives.
    """

    graph: PrefixGraph
    plans: int
    pairs: Tensor
    slots: Tensor


class GraphNetwork(EnsembleNetwork):
    """One round of message passing, update of each block, mean over blocks, readout of two layers.

    Blocks see each other's positions as differences only: a tower is the same wherever it stands, and so is a pair of
    neighbours at any height of it. The last layer of a message is linear, and so is what an update does to the sum of
    messages: `last` and `update_messages` act as one product, after the sum.
    """

    both_ways: bool

    @validate_call
    def __init__(self, *, members: Few, n_features: PositiveInt, n_position: PositiveInt, hidden: Width) -> None:
        super().__init__()
        self.hidden = hidden
        self.n_own = n_own = n_features - n_position
        self.messages = PrefixMessages(members, n_own, n_position, hidden)
        if generated := sys.modules.get(f"{__name__}_PrefixMessages_propagate"):  # from a file that nobody cleans up
            Path(str(generated.__file__)).unlink(missing_ok=True)
        self.last = EnsembleLinear(members, hidden + 1, hidden, last_is_one=True)
        self.update_messages = EnsembleLinear(members, hidden, hidden, bias=False, fan_in=n_own + hidden)
        self.update_own = EnsembleLinear(members, n_own + 1, hidden, last_is_one=True, fan_in=n_own + hidden)
        self.readout = EnsembleLinear(members, hidden, hidden)
        self.logit = EnsembleLinear(members, hidden, 1)

    def forward(self, x: Tensor, whole: bool = False) -> Tensor:
        """[E, N, K, F] -> [E, N, K - 1], or [E, N, 1] if `whole`; see `EnsembleNetwork.forward`."""
        return self.logits_of(self.prepare(x, whole))

    def prepare(self, x: Tensor, whole: bool = False) -> Prepared:
        """[E, N, K, F] -> what the layers read of them."""
        e, n, k, _ = x.shape
        x = x.transpose(1, 2).contiguous()
        graph = prefix_graph(k, self.both_ways, whole, x.device)
        own, position = x.split([self.n_own, x.shape[-1] - self.n_own], -1)
        source, target = graph.edges
        seen = position.index_select(1, source) - position.index_select(1, target)
        one = x.new_ones(e, 1, n, 1)
        pairs = [own.index_select(1, source), own.index_select(1, target), seen, one.expand(-1, len(source), -1, -1)]
        number = graph.n_received.expand(e, -1, n, 1)
        slots = [own.index_select(1, graph.block), one.expand_as(number), number]
        return Prepared(graph, n, torch.cat(pairs, -1).flatten(1, 2), torch.cat(slots, -1).flatten(1, 2))

    def batcher(self, x: Tensor, whole: bool = False) -> Callable[[Tensor], Prepared]:
        """As `EnsembleNetwork.batcher`: examples are prepared once, and lie plan by plan to be gathered fast."""
        prepared = self.prepare(x[None], whole)
        parts = [part.view(-1, len(x), part.shape[2]).transpose(0, 1) for part in (prepared.pairs, prepared.slots)]
        by_plan = torch.cat([part.flatten(1) for part in parts], 1)
        (_, pairs, of_pair), (_, slots, of_slot) = (part.shape for part in parts)
        width = by_plan.shape[1]

        def batch(rows: Tensor) -> Prepared:
            e, n = rows.shape
            drawn = by_plan.index_select(0, rows.flatten())

            def by_node(start: int, nodes: int, features: int) -> Tensor:
                shape, strides = (e, nodes, n, features), (n * width, features, width, 1)
                return drawn.as_strided(shape, strides, start).flatten(1, 2)

            return Prepared(prepared.graph, n, by_node(0, pairs, of_pair), by_node(pairs * of_pair, slots, of_slot))

        return batch

    def logits_of(self, prepared: Prepared) -> Tensor:
        """[E, N, K - 1], or [E, N, 1] of the whole plans."""
        received = self.messages(prepared.pairs, prepared.graph)
        of_sum, of_number = torch.bmm(self.last.weight, self.update_messages.weight).split([self.hidden, 1], 1)
        slots = self.update_own(prepared.slots, of_number)
        slots[:, : received.shape[1]] += affine(received, of_sum)
        logits = self.logit(self.readout(prepared.graph.means(slots.relu_()), relu=True))
        return logits.view(len(slots), -1, prepared.plans).transpose(1, 2)

    def vjp(self) -> VJP:
        """As `EnsembleNetwork.vjp`, written out; a subclass that computes something else is left to autograd."""
        return written_out(self) if self.replayable else super().vjp()

    @property
    def replayable(self) -> bool:
        """As `EnsembleNetwork.replayable`: yes, unless a subclass computes something else."""
        own = (type(self).batcher, type(self).logits_of, type(self.messages))
        return own == (GraphNetwork.batcher, GraphNetwork.logits_of, PrefixMessages)


class TowersGraphNetwork(GraphNetwork):
    """TGN: each block hears from those above it, as the analytic rule compares them."""

    both_ways = False


class FullyConnectedGraphNetwork(GraphNetwork):
    """FCGN: the same networks, with messages between all pairs of blocks."""

    both_ways = True
