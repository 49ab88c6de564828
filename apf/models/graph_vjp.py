"""The passes of a graph network written out, forwards and backwards: this is where training spends its time."""

from typing import TYPE_CHECKING

import torch
from torch import Tensor, baddbmm, bmm

from apf.models.layers import VJP, Backward
from apf.models.readout_vjp import readout_vjp, relu_backward

if TYPE_CHECKING:
    from apf.models.graph import GraphNetwork, Prepared


def written_out(network: "GraphNetwork") -> VJP:
    """What `GraphNetwork.logits_of` computes, and its way back, for weights that stay where they are.

    Products of this size are over so soon that the time counts which autograd takes between them, and which it takes to
    look weights up in their modules again and again.
    """
    message, hidden = network.messages, network.hidden
    layers = [message.first, message.middle, network.last, network.update_messages, network.update_own]
    first, middle, last, update, own = (layer.weight.detach() for layer in layers)
    _, middle_bias = (parameter.detach() for parameter in message.middle.parameters())
    middle_back, last_back, update_back = (weight.mT for weight in (middle, last, update))
    readout = readout_vjp(network.readout, network.logit)

    @torch.inference_mode()
    def vjp(prepared: "Prepared") -> tuple[Tensor, Backward]:
        graph, pairs, slots = prepared.graph, prepared.pairs, prepared.slots
        x1 = bmm(pairs, first).relu_()
        x2 = baddbmm(middle_bias, x1, middle).relu_()  # messages, all but their last layer
        heard = graph.received(x2.clone())
        of_sum, of_number = bmm(last, update).split([hidden, 1], 1)
        x3 = bmm(slots, torch.cat([own, of_number], 1))
        x3[:, : heard.shape[1]].baddbmm_(heard, of_sum)
        x3.relu_()  # what is known of slots
        logits, readout_back = readout(graph.means(x3), prepared.plans)

        @torch.inference_mode()
        def backward(gradient: Tensor) -> list[Tensor]:
            """In the order of the network's parameters; `g` is the gradient of one x after another."""
            g, of_readout = readout_back(gradient)
            g = graph.means_vjp(g)
            relu_backward(g, x3, 0, grad_input=g)
            of_own, of_number = bmm(slots.mT, g).split([own.shape[1], 1], 1)
            g = g[:, : heard.shape[1]]
            of_both = torch.cat([bmm(heard.mT, g), of_number], 1)
            of_last, of_update = bmm(of_both, update_back), bmm(last_back, of_both)
            g = graph.received_vjp(bmm(g, of_sum.mT))
            relu_backward(g, x2, 0, grad_input=g)
            of_middle = [bmm(x1.mT, g), g.sum(1, keepdim=True)]
            g = bmm(g, middle_back)
            relu_backward(g, x1, 0, grad_input=g)
            return [bmm(pairs.mT, g), *of_middle, of_last, of_update, of_own, *of_readout]

        return logits, backward

    return vjp
