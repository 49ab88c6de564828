"""A GPU for machines that have none: it computes on the CPU, and refuses what a GPU refuses.

`PretendGPU` is a mode of PyTorch. Inside it a tensor made for, or moved to, "cuda" says that it lies there; whatever
mixes it with a tensor of the CPU, draws for it with a generator of the CPU, or reads it as an array without moving it,
raises what PyTorch raises. `PretendGraph` records a CUDA graph: operations with the places in memory that they read and
write.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

ABOUT_TENSORS = {
    *("device", "_parse_to", "_has_compatible_shallow_copy_type"),
    *("is_leaf", "requires_grad", "shape", "dtype", "grad_fn", "ndim", "layout", "names"),
}
"""Functions and properties that make no tensor of others."""

CUDA, CPU = torch.device("cuda"), torch.device("cpu")


def on_gpu(value: object) -> bool:
    """Does this tensor pretend to lie on the GPU?"""
    return isinstance(value, Tensor) and getattr(value, "pretends", False)


def _leaves(value: Any) -> list[Any]:
    """What lists, tuples and dicts hold, at any depth."""
    if isinstance(value, dict):
        value = list(value.values())
    return [leaf for part in value for leaf in _leaves(part)] if isinstance(value, list | tuple) else [value]


def _mark(value: Any, gpu: bool) -> Any:
    """Let all tensors of a result lie there."""
    if isinstance(value, Tensor):
        value.pretends = gpu  # type: ignore[attr-defined]
    elif isinstance(value, list | tuple):
        for part in value:
            _mark(part, gpu)
    return value


def _device_of(value: object) -> torch.device | None:
    """The device that an argument names, if it does."""
    if isinstance(value, torch.device):
        return value
    if isinstance(value, str) and value.split(":")[0] in ("cpu", "cuda"):
        return torch.device(value)
    return None


def _without_devices(arguments: Any) -> Any:
    """The arguments with every device of a GPU replaced by the CPU."""
    if isinstance(arguments, dict):
        return {name: _without_devices(value) for name, value in arguments.items()}
    if type(arguments) in (list, tuple):
        return type(arguments)(map(_without_devices, arguments))
    return CPU if _device_of(arguments) is not None else arguments


class PretendGPU(TorchFunctionMode):
    """See above. moves: how many tensors came back from the GPU, each of which waits for it.

    replaying: a graph is replayed, which looks at no device. capturing: a graph is recorded.
    """

    moves = 0
    replaying = False
    capturing = False

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if PretendGPU.replaying:
            return func(*args, **kwargs)
        name = getattr(func, "__name__", "")
        owner = getattr(getattr(func, "__self__", None), "__name__", "")  # of a property: its getter or setter
        tensors = [leaf for leaf in _leaves((args, kwargs)) if isinstance(leaf, Tensor)]
        gpu = any(map(on_gpu, tensors))
        if owner == "device":
            return CUDA if gpu else CPU
        if owner == "is_cuda":
            return gpu
        if owner == "data" and name == "__set__":
            return _mark_set(func, args)
        if name in ABOUT_TENSORS or owner in ABOUT_TENSORS:
            return func(*args, **kwargs)
        if name in ("cpu", "cuda", "to"):
            return self.move(func, args, kwargs)
        if name == "numpy":
            if gpu and not kwargs.get("force"):
                raise TypeError("can't convert cuda:0 device type tensor to numpy. Use Tensor.cpu() first.")
            self.moves += gpu
            return func(*args, **kwargs)
        named = next((d for value in _leaves((args, kwargs)) if (d := _device_of(value)) is not None), None)
        target = gpu if named is None else named.type == "cuda"
        generator = kwargs.get("generator")
        if target and isinstance(generator, torch.Generator):
            raise RuntimeError("Expected a 'cuda' device type for generator but found 'cpu'")
        if name not in ("copy_", "__setitem__") and gpu:
            _refuse_mixture(name, tensors)
        if name == "__setitem__" and gpu:
            _refuse_mixture(name, [leaf for leaf in _leaves(args[:2]) if isinstance(leaf, Tensor)])
        if name in ("item", "tolist", "__bool__", "__int__", "__float__", "__index__", "nonzero"):
            self.moves += gpu
        if name == "__iter__":
            return iter(_mark(list(args[0].unbind()), gpu))
        if named is not None:
            args, kwargs = _without_devices(args), _without_devices(kwargs)
        return _mark(func(*args, **kwargs), target)

    def move(self, func: Any, args: Any, kwargs: Any) -> Tensor:
        """What `Tensor.to`, `cpu` and `cuda` do."""
        x, *rest = args
        others = [*rest, *kwargs.values()]
        named = next((d for value in others if (d := _device_of(value)) is not None), None)
        like = next((value for value in others if isinstance(value, Tensor)), None)
        gpu = on_gpu(x) if named is None else named.type == "cuda"
        gpu = on_gpu(like) if like is not None else gpu
        gpu = {"cpu": False, "cuda": True}.get(func.__name__, gpu)
        self.moves += on_gpu(x) and not gpu
        moved = x.detach() if func.__name__ == "cuda" else func(x, *_without_devices(rest), **_without_devices(kwargs))
        if gpu == on_gpu(x):
            return _mark(moved, gpu)
        return _mark(moved.clone() if moved is x or moved.data_ptr() == x.data_ptr() else moved, gpu)


def _mark_set(func: Any, args: Any) -> Any:
    """Setting `x.data` moves x, too."""
    result = func(*args)
    _mark(args[0], on_gpu(args[1]))
    return result


def _refuse_mixture(name: str, tensors: list[Tensor]) -> None:
    """A GPU takes numbers of the CPU, and nothing else."""
    if any(not on_gpu(tensor) and tensor.dim() for tensor in tensors):
        raise RuntimeError(f"{name}: Expected all tensors to be on the same device, found at least two: cuda:0 and cpu")


class PretendGraph:
    """Stands for `torch.cuda.CUDAGraph`: what was recorded, done again in the same memory."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, Any, Any, list[tuple[int, Tensor]]]] = []
        """Operation, arguments, and which of its results are left where."""
        self.replays = 0

    def replay(self) -> None:
        """Do all operations, whatever has become of the values meanwhile."""
        self.replays += 1
        with torch.inference_mode(), pytest.MonkeyPatch.context() as patch:
            patch.setattr(PretendGPU, "replaying", True)
            for func, args, kwargs, places in self.calls:
                made = func(*args, **kwargs)
                for number, place in places:
                    place.copy_(_leaves(made)[number])


class _Recorder(TorchDispatchMode):
    """Notes operations. What changes tensors is only noted, not done, as by a GPU that records."""

    def __init__(self, graph: PretendGraph) -> None:
        super().__init__()
        self.graph = graph

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if func.namespace == "profiler":  # an optimiser notes when its step begins and ends
            return func(*args, **kwargs)
        if func.overloadpacket.__name__ in ("_local_scalar_dense", "nonzero", "is_nonzero"):
            raise RuntimeError("operation not permitted when stream is capturing")
        written = [
            kwargs.get(argument.name, args[place] if place < len(args) else None)
            for place, argument in enumerate(func._schema.arguments)
            if argument.alias_info is not None and argument.alias_info.is_write
        ]
        if written:
            self.graph.calls.append((func, args, kwargs, []))
            return written[0] if len(func._schema.returns) == 1 else None
        out = func(*args, **kwargs)
        places = [(number, leaf) for number, leaf in enumerate(_leaves(out)) if not _shares(leaf, args, kwargs)]
        for _, place in places:
            if place.is_floating_point():
                place.fill_(torch.nan)  # a GPU that records has computed nothing
        self.graph.calls.append((func, args, kwargs, places))
        return out


def _shares(tensor: Tensor, args: Any, kwargs: Any) -> bool:
    """Does a result lie in the memory of an argument?"""
    places = {leaf.untyped_storage().data_ptr() for leaf in _leaves((args, kwargs)) if isinstance(leaf, Tensor)}
    return tensor.untyped_storage().data_ptr() in places


@contextmanager
def _recording(graph: PretendGraph, pool: object = None) -> Iterator[None]:
    """Stands for `torch.cuda.graph`."""
    with _Recorder(graph), pytest.MonkeyPatch.context() as patch:
        patch.setattr(PretendGPU, "capturing", True)
        yield


@contextmanager
def pretend_gpu() -> Iterator[PretendGPU]:
    """A machine with a GPU."""
    gradients, grouped = torch.autograd.grad, torch.optim.Optimizer._group_tensors_by_device_and_dtype
    with pytest.MonkeyPatch.context() as patch, PretendGPU() as gpu:
        patch.setattr(torch.cuda, "is_available", lambda: True)
        stream = SimpleNamespace(is_capturing=lambda: PretendGPU.capturing)
        patch.setattr(torch.accelerator, "current_accelerator", lambda check_available=False: CUDA)
        patch.setattr(torch.accelerator, "current_stream", lambda device=None: stream)
        patch.setattr(torch.cuda, "CUDAGraph", PretendGraph)
        patch.setattr(torch.cuda, "graph", _recording)
        patch.setattr(torch.cuda, "graph_pool_handle", lambda: (0, 0))
        properties = SimpleNamespace(total_memory=2**33, name="Pretended GPU")
        patch.setattr(torch.cuda, "get_device_properties", lambda device: properties)
        patch.setattr(torch.autograd, "grad", lambda y, *a, **k: _mark(gradients(y, *a, **k), on_gpu(y)))
        patch.setattr(
            torch.optim.Optimizer,
            "_group_tensors_by_device_and_dtype",
            lambda lists, *a: {
                (CUDA if on_gpu(lists[0][0]) else CPU, dtype): group for (_, dtype), group in grouped(lists, *a).items()
            },
        )
        yield gpu
