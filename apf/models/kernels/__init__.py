"""Forward and backward passes written out by hand, where they are much faster than a network's definition.

A kernel computes what the network's `forward` defines; tests compare values, gradients and trained weights. A kernel
stays only if a whole training or a whole prediction is at least 1.25 times as fast with it.
"""

from apf.models.kernels.graph import GraphKernel
from apf.models.kernels.lstm import LSTMKernel
from apf.models.layers import EnsembleNetwork
from apf.models.passes import Passes

KERNELS: dict[str, type[Passes]] = {
    "apf.models.graph.TGN": GraphKernel,
    "apf.models.graph.FCGN": GraphKernel,
    "apf.models.lstm.LSTMNetwork": LSTMKernel,
}
"""By the name of the class, so that torch-geometric is imported only where a network needs it."""


def passes_of(network: EnsembleNetwork, kernels: bool = True) -> Passes:
    """The passes of a network: its kernel if there is one and `kernels` are wanted, else its definition.

    A sub-class may compute something else than its parent, so a kernel serves only the class it was written for.
    """
    name = f"{type(network).__module__}.{type(network).__qualname__}"
    return KERNELS.get(name, Passes)(network) if kernels else Passes(network)
