"""The passes of a graph network written out, forwards and backwards: this is where training spends its time."""

from typing import TYPE_CHECKING

import torch
from torch import Tensor, baddbmm, bmm

from apf.models.layers import VJP, Backward

if TYPE_CHECKING:
    from apf.models.graph import GraphNetwork, Prepared

_relu_backward = torch.ops.aten.threshold_backward.grad_input


def written_out(network: "GraphNetwork") -> VJP:
    """What `GraphNetwork.logits_of` computes, and its way back, for weights that stay where they are.

    Products of this size are over so soon that the time counts which autograd takes between them, and which it takes to
    look weights up in their modules again and again.
    """
    message, hidden = network.messages, network.hidden
    layers = [message.first, message.middle, network.last, network.update_messages, network.update_own]
    first, middle, last, update, own = (layer.weight.detach() for layer in layers)
    readout, logit = network.readout.weight.detach(), network.logit.weight.detach()
    middle_bias, readout_bias, logit_bias = (
        layer.bias.detach() for layer in (message.middle, network.readout, network.logit) if layer.bias is not None
    )
    middle_back, last_back, update_back, readout_back, logit_back = (
        weight.mT for weight in (middle, last, update, readout, logit)
    )

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
        x4 = graph.means(x3)  # of prefixes
        x5 = baddbmm(readout_bias, x4, readout).relu_()
        logits = baddbmm(logit_bias, x5, logit)

        @torch.inference_mode()
        def backward(gradient: Tensor) -> list[Tensor]:
            """In the order of the network's parameters; `g` is the gradient of one x after another."""
            g = gradient.transpose(1, 2).reshape(logits.shape)
            of_logit = [bmm(x5.mT, g), g.sum(1, keepdim=True)]
            g = g * logit_back
            _relu_backward(g, x5, 0, grad_input=g)
            of_readout = [bmm(x4.mT, g), g.sum(1, keepdim=True)]
            g = graph.means_vjp(bmm(g, readout_back))
            _relu_backward(g, x3, 0, grad_input=g)
            of_own, of_number = bmm(slots.mT, g).split([own.shape[1], 1], 1)
            g = g[:, : heard.shape[1]]
            of_both = torch.cat([bmm(heard.mT, g), of_number], 1)
            of_last, of_update = bmm(of_both, update_back), bmm(last_back, of_both)
            g = graph.received_vjp(bmm(g, of_sum.mT))
            _relu_backward(g, x2, 0, grad_input=g)
            of_middle = [bmm(x1.mT, g), g.sum(1, keepdim=True)]
            g = bmm(g, middle_back)
            _relu_backward(g, x1, 0, grad_input=g)
            return [bmm(pairs.mT, g), *of_middle, of_last, of_update, of_own, *of_readout, *of_logit]

        return logits.view(len(logits), -1, prepared.plans).transpose(1, 2), backward

    return vjp
