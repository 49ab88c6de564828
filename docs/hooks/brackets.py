"""Shapes and units in docstrings, such as [N, 3] [m], are text; Markdown would take a pair of brackets for a link."""

from typing import Any

import griffe


class Brackets(griffe.Extension):
    """Escapes the second bracket of each pair."""

    def on_instance(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Of each object of the package, as it is read."""
        if obj.docstring:
            obj.docstring.value = obj.docstring.value.replace("] [", "] \\[")
