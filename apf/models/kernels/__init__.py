"""Forward and backward passes written out by hand, where they are much faster than a network's definition.

A kernel computes what the network's `forward` defines; tests compare values, gradients and trained weights. A kernel
stays only if a whole training or a whole prediction is at least 1.25 times as fast with it.
"""

from apf.models.kernels.graph import GraphKernel
from apf.models.kernels.lstm import LSTMKernel
from apf.models.layers import EnsembleNetwork
from apf.models.passes import Passes

KERNELS: dict[str, type[Passes]] = {"apf.TGN": GraphKernel, "apf.FCGN": GraphKernel, "apf.LSTMNetwork": LSTMKernel}
"""By the package and the name of the class, so that torch-geometric is imported only where a network needs it."""


def passes_of(network: EnsembleNetwork, kernels: bool = True) -> Passes:
    """The passes of a network: its kernel if there is one and `kernels` are wanted, else its definition.

    A kernel serves only the class it was written for, and classes that ask for it (`EnsembleNetwork.kernel_of`), made
    of the parts it was written for. Any other sub-class, or another class in place of one of the parts, may compute
    something else.
    """
    name, *parts = dict.fromkeys(
        f"{type(part).__module__.split('.')[0]}.{type(part).__qualname__}" for part in network.modules()
    )
    kernel = KERNELS.get(vars(type(network)).get("kernel_of", name))
    return kernel(network) if kernels and kernel and kernel.parts == tuple(parts) else Passes(network)
