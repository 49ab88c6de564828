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
from apf.models.layers import Backward, EnsembleLinear, EnsembleNetwork, relu_backward_
from apf.models.prefixes import PrefixGraph, mix_nodes, prefix_graph

with put_off("torch._dynamo"):  # the compiler: two of five seconds of a start
    from torch_geometric.nn import MessagePassing


class PrefixMessages(MessagePassing):
    """Messages along the edges of a `PrefixGraph`, summed for every slot, all but their last layer.

    A message is a net of three layers on both blocks' own features and on where the source lies, seen from the target.
    """

    def __init__(self, members: int, n_own: int, n_position: int, hidden: int) -> None:
        super().__init__(aggr="sum", node_dim=-3)
        self.first = EnsembleLinear(members, 2 * n_own + n_position, hidden)
        self.middle = EnsembleLinear(members, hidden, hidden)

    def forward(self, pairs: Tensor, graph: PrefixGraph) -> Tensor:
        """Features of all pairs [E, P x N, 2 (F - D) + D] -> [E, S, N x H]: what each slot receives."""
        return self.propagate(graph.edges, pairs=pairs, received=graph.received)

    def message(self, pairs: Tensor) -> Tensor:
        """Features of all pairs -> [E, P x N, H]."""
        return self.middle(self.first(pairs).relu_()).relu_()

    def aggregate(self, inputs: Tensor, received: Tensor) -> Tensor:
        """[E, P x N, H] -> [E, S, N x H]: sums over the edges into each slot, as one product with a 0/1 matrix."""
        return mix_nodes(received, inputs)

    def vjp(self, pairs: Tensor, graph: PrefixGraph) -> tuple[Tensor, Backward]:
        """What `forward` returns, and the way back to the gradients of first and middle layer."""
        first = self.first(pairs).relu_()
        messages = self.middle(first).relu_()

        def backward(gradient: Tensor) -> list[Tensor]:
            gradient = relu_backward_(mix_nodes(graph.received.mT, gradient).view_as(messages), messages)
            of_middle = self.middle.gradients(first, gradient)
            gradient = relu_backward_(self.middle.input_gradient(gradient), first)
            return [*self.first.gradients(pairs, gradient), *of_middle]

        return mix_nodes(graph.received, messages), backward


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is known of N plans before any weight: features side by side for each edge, slot and block alone.

    E is 1 where all members are shown the same plans. D of the F features are a position.
    pairs: [E, P x N, 2 (F - D) + D] of source, target, and where the one lies, seen from the other.
    slots: [E, S x N, F - D + 1] of the block, and how many messages it receives. alone: [E, A x N, F - D].
    """

    graph: PrefixGraph
    plans: int
    pairs: Tensor
    slots: Tensor
    alone: Tensor


class GraphNetwork(EnsembleNetwork):
    """One round of message passing, update of each block, mean over blocks, readout of two layers.

    Blocks see each other's positions as differences only: a tower is the same wherever it stands, and so is a pair of
    neighbours at any height of it. The last layer of a message is linear, and so is what an update does to the sum of
    messages: `last` and `update_messages` act as one product, after the sum.
    """

    both_ways: bool

    @validate_call
    def __init__(
        self, *, members: PositiveInt, n_features: PositiveInt, n_position: PositiveInt, hidden: PositiveInt
    ) -> None:
        super().__init__()
        self.hidden = hidden
        self.n_own = n_own = n_features - n_position
        self.messages = PrefixMessages(members, n_own, n_position, hidden)
        if generated := sys.modules.get(f"{__name__}_PrefixMessages_propagate"):  # from a file that nobody cleans up
            Path(str(generated.__file__)).unlink(missing_ok=True)
        self.last = EnsembleLinear(members, hidden, hidden)
        self.update_messages = EnsembleLinear(members, hidden, hidden, bias=False, fan_in=n_own + hidden)
        self.update_own = EnsembleLinear(members, n_own, hidden, fan_in=n_own + hidden)
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
        pairs = torch.cat([own.index_select(1, source), own.index_select(1, target), seen], -1)
        slots = torch.cat([own.index_select(1, graph.block), graph.n_received.expand(e, -1, n, 1)], -1)
        alone = own.index_select(1, graph.alone)
        return Prepared(graph, n, pairs.flatten(1, 2), slots.flatten(1, 2), alone.flatten(1, 2))

    def batcher(self, x: Tensor, whole: bool = False) -> Callable[[Tensor], Prepared]:
        """As `EnsembleNetwork.batcher`: examples are prepared once, and lie plan by plan to be gathered fast."""
        prepared = self.prepare(x[None], whole)
        parts = [part.view(-1, len(x), part.shape[2]) for part in (prepared.pairs, prepared.slots, prepared.alone)]
        shapes = [(len(part), part.shape[2]) for part in parts]
        widths = [nodes * features for nodes, features in shapes]
        by_plan = x.new_empty(len(x), sum(widths))
        for place, shape, part in zip(by_plan.split(widths, 1), shapes, parts, strict=True):
            place.view(len(x), *shape).copy_(part.transpose(0, 1))
        graph = prepared.graph

        def batch(rows: Tensor) -> Prepared:
            e, n = rows.shape
            drawn = by_plan.index_select(0, rows.flatten()).view(e, n, -1).split(widths, 2)
            shaped = (part.view(e, n, *shape) for part, shape in zip(drawn, shapes, strict=True))
            return Prepared(graph, n, *(part.transpose(1, 2).flatten(1, 2) for part in shaped))

        return batch

    def logits_of(self, prepared: Prepared) -> Tensor:
        """[E, N, K - 1], or [E, N, 1] of the whole plans."""
        graph = prepared.graph
        weight, bias = self.last.then(self.update_messages)
        slots = self.update_own(prepared.slots, bias)
        slots = slots.baddbmm_(self.messages(prepared.pairs, graph).view_as(slots), weight).relu_()
        alone = None if self.both_ways else self.update_own(prepared.alone).relu_()
        logits = self.logit(self.readout(self._average(graph, slots, alone)).relu_())
        return logits.view(len(slots), -1, prepared.plans).transpose(1, 2)

    def _average(self, graph: PrefixGraph, slots: Tensor, alone: Tensor | None) -> Tensor:
        """What is known of blocks -> [E, R x N, H], means over the blocks of each prefix."""
        if alone is None:
            mean = mix_nodes(graph.mean, slots)
        else:
            of_slots = graph.mean.expand(len(slots), -1, -1), slots.view(len(slots), len(graph.block), -1)
            mean = mix_nodes(graph.mean_alone, alone).baddbmm_(*of_slots)
        return mean.view(len(slots), -1, self.hidden)

    def vjp(self, prepared: Prepared) -> tuple[Tensor, Backward]:
        """As `EnsembleNetwork.vjp`, by hand; a subclass with another `logits_of` is left to autograd."""
        by_hand = type(self).logits_of is GraphNetwork.logits_of
        return self._vjp(prepared) if by_hand else super().vjp(prepared)

    @torch.inference_mode()
    def _vjp(self, prepared: Prepared) -> tuple[Tensor, Backward]:
        """What `logits_of` computes, and its way back, without what autograd spends between products of this size."""
        graph = prepared.graph
        received, backward_messages = self.messages.vjp(prepared.pairs, graph)
        weight, bias = self.last.then(self.update_messages)
        slots = self.update_own(prepared.slots, bias)
        received = received.view_as(slots)
        slots = slots.baddbmm_(received, weight).relu_()
        alone = None if self.both_ways else self.update_own(prepared.alone).relu_()
        prefixes = self._average(graph, slots, alone)
        read = self.readout(prefixes).relu_()
        logits = self.logit(read)

        @torch.inference_mode()
        def backward(gradient: Tensor) -> list[Tensor]:
            gradient = gradient.transpose(1, 2).reshape_as(logits)
            of_logit = self.logit.gradients(read, gradient)
            gradient = relu_backward_(self.logit.input_gradient(gradient), read)
            of_readout = self.readout.gradients(prefixes, gradient)
            of_prefixes = self.readout.input_gradient(gradient)
            gradient = relu_backward_(mix_nodes(graph.mean.mT, of_prefixes).view_as(slots), slots)
            of_own_and_n, of_own_bias = self.update_own.gradients(prepared.slots, gradient)
            of_own, of_bias = of_own_and_n.split([self.n_own, 1], 1)
            of_last = self.last.gradients_then(self.update_messages, torch.bmm(received.mT, gradient), of_bias)
            of_messages = backward_messages(torch.bmm(gradient, weight.mT))
            if alone is not None:
                gradient = relu_backward_(mix_nodes(graph.mean_alone.mT, of_prefixes).view_as(alone), alone)
                of_alone, of_alone_bias = self.update_own.gradients(prepared.alone, gradient)
                of_own, of_own_bias = of_own + of_alone, of_own_bias + of_alone_bias
            return [*of_messages, *of_last, of_own, of_own_bias, *of_readout, *of_logit]

        return logits.view(len(slots), -1, prepared.plans).transpose(1, 2), backward


class TowersGraphNetwork(GraphNetwork):
    """TGN: each block hears from those above it, as the analytic rule compares them."""

    both_ways = False


class FullyConnectedGraphNetwork(GraphNetwork):
    """FCGN: the same networks, with messages between all pairs of blocks."""

    both_ways = True
