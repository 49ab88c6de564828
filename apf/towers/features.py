"""What a network sees of each placement."""

import numpy as np

from apf.towers.towers import Towers

N_FEATURES = 10
"""Mass, centre of mass (3), sides (3), position (3)."""


def features(towers: Towers) -> np.ndarray:
    """[N, K, N_FEATURES] float32: mass, centre of mass, sides and position after rotation.

    Lengths are in cm and centred (mass on 0.55 kg, sides on 10 cm), which brings all to about unit range.
    Positions are relative to the bottom block: where on the table a tower stands does not matter.
    """
    n, k = towers.block.shape
    x = np.empty((n, k, N_FEATURES), np.float32)
    x[..., 0] = towers.mass - 0.55
    x[..., 1:4] = towers.com * 100
    x[..., 4:7] = (towers.dims - 0.1) * 100
    x[..., 7:9] = (towers.xy - towers.xy[:, :1]) * 100
    x[..., 9] = (towers.z - towers.z[:, :1]) * 100
    return x
