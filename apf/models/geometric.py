"""torch-geometric, without the warnings of its import that concern torch-geometric alone."""

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore", FutureWarning)  # it calls torch.jit.script, which torch 2.14 deprecates
    warnings.simplefilter("ignore", DeprecationWarning)
    from torch_geometric.nn.aggr import MeanAggregation
    from torch_geometric.nn.conv import MessagePassing
    from torch_geometric.typing import OptTensor

__all__ = ["MeanAggregation", "MessagePassing", "OptTensor"]
