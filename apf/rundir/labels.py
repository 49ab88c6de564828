"""Labels as the journal writes them: one character for each prefix."""

import re
from typing import Any

import numpy as np

SYMBOL = {1: "1", 0: "0", -1: "-"}
"""The character of a label: succeeded, failed, not attempted."""
VALUE = {symbol: label for label, symbol in SYMBOL.items()}
LABELS = re.compile("1*(0-*)?")
"""Those that succeeded, one that failed unless all succeeded, the rest not attempted."""


def symbols_of(labels: np.ndarray) -> str:
    """Labels [K] as text of K characters."""
    return "".join(SYMBOL[int(label)] for label in labels)


def labels_of(symbols: Any) -> np.ndarray:
    """[K] int8 labels of text of K characters. Raises ValueError if it is none."""
    if not isinstance(symbols, str) or not LABELS.fullmatch(symbols):
        raise ValueError(
            f"labels are {symbols!r}; they are 1 for each prefix that stood, then one 0, then - to the end"
        )
    return np.array([VALUE[symbol] for symbol in symbols], np.int8)
