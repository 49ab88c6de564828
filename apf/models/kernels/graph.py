"""The passes of TGN and FCGN written out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor, baddbmm, bmm, cat

from apf.models.kernels.readout import readout_vjp, relu_backward
from apf.models.kernels.shared import SharedGraph, shared_graph
from apf.models.passes import Backward, Passes

if TYPE_CHECKING:
    from apf.models.graph import GraphNetwork


@dataclass(frozen=True, eq=False)
class PreparedGraphs:
    """The inputs of the layers for N plans, side by side for each edge and node.

    E is 1 where all members see the same plans. D of the F features are a position.

    pairs: [E, A x N, 2 (F - D) + D + P] features of source and target, position of the source relative to the target,
        features of the pair.
    nodes: [E, V x N, F - D + 2] features of the placement, 1, the number of messages that the node receives.
    """

    graph: SharedGraph
    plans: int
    pairs: Tensor
    nodes: Tensor


class GraphKernel(Passes):
    """One pass for all prefixes, in which each message is computed once.

    The last layer of a message is linear, and the update begins with a linear layer. So both act as one product, after
    the sum: sum_j (h_j W + b) = (sum_j h_j) W + n b for n messages. With a ReLU between (`message_relu`), they are two.
    """

    replayable = True
    parts = (
        "apf.PlacementConv",
        "torch_geometric.SumAggregation",
        "torch.Sequential",
        "apf.EnsembleLinear",
        "torch.ReLU",
        "torch_geometric.MeanAggregation",
    )
    network: "GraphNetwork"

    def prepare(self, x: Tensor, last_only: bool = False) -> PreparedGraphs:
        """As `Passes.prepare`."""
        e, n, k, _ = x.shape
        x = x.transpose(1, 2).contiguous()
        graph = shared_graph(k, self.network.both_ways, last_only, x.device)
        own, position = x.split(self.network.sizes, -1)
        source, target = graph.edge_index
        relative = position.index_select(1, source) - position.index_select(1, target)
        of_pair = self.network.pair_features(x, graph.edge_index)
        of_pairs = [] if of_pair is None else [of_pair]
        pairs = cat([own.index_select(1, source), own.index_select(1, target), relative, *of_pairs], -1)
        number = graph.n_received.expand(e, -1, n, 1)
        nodes = cat([own.index_select(1, graph.placement), torch.ones_like(number), number], -1)
        return PreparedGraphs(graph, n, pairs.flatten(1, 2), nodes.flatten(1, 2))

    def batcher(self, x: Tensor, last_only: bool = False) -> Callable[[Tensor], PreparedGraphs]:
        """As `Passes.batcher`: the inputs of each example lie in one row, so that a batch is one gather."""
        prepared = self.prepare(x[None], last_only)
        parts = [part.view(-1, len(x), part.shape[2]).transpose(0, 1) for part in (prepared.pairs, prepared.nodes)]
        by_plan = cat([part.flatten(1) for part in parts], 1)
        (_, pairs, of_pair), (_, nodes, of_node) = (part.shape for part in parts)
        width = by_plan.shape[1]

        def batch(rows: Tensor) -> PreparedGraphs:
            e, n = rows.shape
            drawn = by_plan.index_select(0, rows.flatten())

            def side_by_side(start: int, count: int, features: int) -> Tensor:
                shape, strides = (e, count, n, features), (n * width, features, width, 1)
                return drawn.as_strided(shape, strides, start).flatten(1, 2)

            of_pairs, of_nodes = side_by_side(0, pairs, of_pair), side_by_side(pairs * of_pair, nodes, of_node)
            return PreparedGraphs(prepared.graph, n, of_pairs, of_nodes)

        return batch

    def logits(self, prepared: PreparedGraphs) -> Tensor:
        """As `Passes.logits`."""
        return self._passes(prepared, learn=False)[0]

    def vjp(self, prepared: PreparedGraphs) -> tuple[Tensor, Backward]:
        """As `Passes.vjp`."""
        return self._passes(prepared, learn=True)

    @torch.inference_mode()
    def _passes(self, prepared: PreparedGraphs, learn: bool) -> tuple[Tensor, Backward]:
        """Logits and the way back; `learn`: keep what the way back needs."""
        graph, members, message_relu = prepared.graph, len(self.parameters[0]), self.network.message_relu
        pairs, nodes = (x.expand(members, -1, -1) for x in (prepared.pairs, prepared.nodes))
        first, first_bias, second, second_bias, third, third_bias, update, update_bias, *readout = self.parameters
        n_hidden = second.shape[2]
        of_messages, of_own = update.split([n_hidden, update.shape[1] - n_hidden], 1)
        last = cat([third, third_bias], 1)  # the message's last layer, for the sum and the number of messages
        of_sum, of_number = bmm(last, of_messages).split([n_hidden, 1], 1)
        h1 = baddbmm(first_bias, pairs, first).relu_()
        h2 = messages = baddbmm(second_bias, h1, second).relu_()
        if message_relu:
            messages = baddbmm(third_bias, h2, third).relu_()
            of_sum, of_number = of_messages, torch.zeros_like(of_number)
        sums = graph.aggregate(messages.clone() if learn else messages)
        h3 = bmm(nodes, cat([of_own, update_bias, of_number], 1))
        h3[:, : sums.shape[1]].baddbmm_(sums, of_sum)
        h3.relu_()
        logits, readout_backward = readout_vjp(graph.means(h3), readout, prepared.plans)

        @torch.inference_mode()
        def backward(gradient: Tensor) -> list[Tensor]:
            """`g` is the gradient of one layer's output after another's."""
            g, readout_gradients = readout_backward(gradient)
            g = relu_backward(graph.means_vjp(g), h3)
            own_gradient, update_bias_gradient, of_number = bmm(nodes.mT, g).split([of_own.shape[1], 1, 1], 1)
            g = g[:, : sums.shape[1]]
            of_product = cat([bmm(sums.mT, g), of_number], 1)
            if message_relu:
                update_gradient = cat([of_product[:, :n_hidden], own_gradient], 1)
            else:
                update_gradient = cat([bmm(last.mT, of_product), own_gradient], 1)
            g = relu_backward(graph.aggregate_vjp(bmm(g, of_sum.mT)), messages)
            if message_relu:
                third_gradients = (bmm(h2.mT, g), g.sum(1, keepdim=True))
                g = relu_backward(bmm(g, third.mT), h2)
            else:
                third_gradients = bmm(of_product, of_messages.mT).split([n_hidden, 1], 1)
            second_gradients = [bmm(h1.mT, g), g.sum(1, keepdim=True)]
            g = relu_backward(bmm(g, second.mT), h1)
            first_gradients = [bmm(pairs.mT, g), g.sum(1, keepdim=True)]
            message_gradients = [*first_gradients, *second_gradients, *third_gradients]
            return [*message_gradients, update_gradient, update_bias_gradient, *readout_gradients]

        return logits, backward
