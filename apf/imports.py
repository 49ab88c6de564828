"""Imports that can wait."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def put_off(name: str) -> Iterator[None]:
    """Let what is imported in this block import a module that it does not use yet, without loading it.

    A stand-in takes its place meanwhile. For modules that their package loads by itself when they are first used, as
    `torch` does with `torch._dynamo`. Does nothing if the module is there already.
    """
    if name in sys.modules:
        yield
        return
    sys.modules[name] = ModuleType(name)
    try:
        yield
    finally:
        del sys.modules[name]
