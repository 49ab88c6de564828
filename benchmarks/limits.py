"""What the machine could do at best: the same matrix products and nothing else, or one pass over the same memory."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode


class Product(NamedTuple):
    """[B, N, M] @ [B, M, P]."""

    b: int
    n: int
    m: int
    p: int


COPIED = 64 * 2**20
"""Bytes of the array whose copy shows the memory's bandwidth: more than any cache holds."""

_aten = torch.ops.aten
_OPERANDS = {
    _aten.mm.default: 0,
    _aten.bmm.default: 0,
    _aten.addmm.default: 1,
    _aten.baddbmm.default: 1,
    _aten.baddbmm_.default: 1,
}
"""Products, and which of their arguments is the left matrix."""


class _Recorder(TorchDispatchMode):
    """Notes the products with weights of a network made while it is active.

    The weights are a factor, or a part of one, or the result has the shape of their gradient.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.products: list[Product] = []
        self._network = network
        self._shapes = {frozenset(p.shape[-2:]) for p in network.parameters()}

    def __torch_dispatch__(self, func: Any, types: Any, args: tuple = (), kwargs: Any = None) -> Any:
        first = _OPERANDS.get(func)
        if first is None:
            with self:
                result = func.decompose(*args, **(kwargs or {}))  # in inference mode products come inside others
            if result is not NotImplemented:
                return result
        else:
            self._note(*args[first : first + 2])
        return func(*args, **(kwargs or {}))

    def _note(self, left: Tensor, right: Tensor) -> None:
        batch, (n, m) = left.shape[0] if left.ndim == 3 else 1, left.shape[-2:]
        p = right.shape[-1]
        weights = {weight.untyped_storage().data_ptr() for weight in self._network.parameters()}
        is_part = any(factor.untyped_storage().data_ptr() in weights for factor in (left, right))
        if is_part or any(frozenset(pair) in self._shapes for pair in ((n, m), (m, p), (n, p))):
            self.products.append(Product(batch, n, m, p))


def products_with_weights(network: nn.Module, work: Callable[[], object]) -> list[Product]:
    """The matrix products that `work` makes, forwards and backwards, in their order.

    Only those with weights of the network as a factor or their gradient as the result: what else is written as a
    product, such as averages over blocks, could be done another way and does not count as necessary work.
    """
    with _Recorder(network) as recorder:
        work()
    return recorder.products


def replay(products: list[Product]) -> Callable[[], None]:
    """Work that makes the products again and nothing else, one thread, on arrays that exist already."""
    makers = {product: _maker(product) for product in set(products)}

    def work() -> None:
        with torch.inference_mode():
            for product in products:
                makers[product]()

    return work


def _maker(product: Product) -> Callable[[], object]:
    """What makes the product once."""
    b, n, m, p = product
    with torch.inference_mode():
        left, right, out = torch.randn(b, n, m), torch.randn(b, m, p), torch.empty(b, n, p)
    return partial(torch.bmm, left, right, out=out)


def flops(products: list[Product]) -> int:
    """Multiplications and additions of the products."""
    return sum(2 * b * n * m * p for b, n, m, p in products)


def memory_pass(n_bytes: int) -> tuple[Callable[[], None], float]:
    """A large copy, and by what its time is to be multiplied for that of reading or writing `n_bytes`."""
    source = np.ones(COPIED, np.uint8)
    target = np.zeros_like(source)

    def work() -> None:
        np.copyto(target, source)

    return work, n_bytes / (2 * COPIED)
