"""Training examples on their device, and the batches that members train on."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from apf.models.examples import Examples

Group = tuple[Tensor, Tensor]
"""Features x [M, K, F] and labels y [M, P] of one length."""


def groups(examples: Sequence[Examples], device: torch.device) -> list[Group]:
    """The examples as tensors there."""
    return [(torch.from_numpy(e.x).to(device), torch.from_numpy(e.y).to(device)) for e in examples]


def last_only(x: Tensor, y: Tensor | np.ndarray) -> bool:
    """Do plans x [M, K, F] have one label each, y [M, 1], instead of one for each prefix of 2..K, [M, K - 1]?"""
    return y.shape[1] < x.shape[1] - 1


def batches(
    sizes: Sequence[tuple[int, int]],
    batch: int,
    generators: Sequence[torch.Generator],
    length_generator: torch.Generator,
    device: torch.device,
) -> Iterator[tuple[int, Tensor]]:
    """Batches without end, epoch after epoch.

    A batch holds plans of one length, so there are few matrix products, and large ones. The order of lengths is the
    same for all members, so that their batches have one shape; the plans in a batch are each member's own.

    Args:
        sizes: for each group, the number of examples, and the number of labels that each of them has.
        batch: approximate number of labels in a batch of one member.
        generators: one per member, for the order of its examples.
        length_generator: for the order of lengths.
        device: where rows are to lie.

    Returns:
        For each batch the number of a group, and rows [E, B] of this group.
    """
    while True:
        epoch = []
        for group, (examples, labels) in enumerate(sizes):
            order = torch.stack([torch.randperm(examples, generator=g) for g in generators]).to(device)
            parts = order.tensor_split(batches_of(examples, labels, batch), dim=1)
            epoch += [(group, part.contiguous()) for part in parts]
        for i in torch.randperm(len(epoch), generator=length_generator).tolist():
            yield epoch[i]


def batches_of(examples: int, labels: int, batch: int) -> int:
    """The number of batches in an epoch of one group.

    Args:
        examples: how many examples the group has.
        labels: how many labels each example has.
        batch: approximate number of labels in a batch.
    """
    return max(1, min(examples, round(examples * labels / batch)))
