"""Tables with a row for each prefix of somebody's plans, in the order of the plans' file."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from apf.domain import NamedPlans


def prefix_table(batches: Sequence[NamedPlans], values: Mapping[str, Sequence[np.ndarray]], word: str) -> pd.DataFrame:
    """One row per placement: plan, position, and the values of the prefix that ends there, in the order of the file.

    Args:
        batches: Plans of one length each.
        values: By the name of a column, its values [N, K] for each batch.
        word: What a plan is called: the name of the first column.
    """
    order = np.concatenate([np.repeat(batch.order, batch.plans.length) for batch in batches])
    position = np.concatenate([np.tile(np.arange(b.plans.length), len(b.plans)) for b in batches])
    rows = np.lexsort((position, order))
    names = pd.Series([name for b in batches for name in b.names], [i for b in batches for i in b.order]).sort_index()
    columns = {name: np.concatenate([np.ravel(part) for part in parts])[rows] for name, parts in values.items()}
    return pd.DataFrame({word: names.to_numpy()[order[rows]], "position": position[rows], **columns})
