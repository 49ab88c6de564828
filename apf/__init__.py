"""Active learning of abstract plan feasibility (Noseworthy, Moses, Brand et al., RSS 2021).

`apf.run`, `apf.load_run`, `apf.plan`, `apf.predict` and `apf.label` are what a program or a notebook needs; `apf.api`
says more. Each is imported when it is first used: `import apf` alone takes no time.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from apf.api import Found, Run, label, load_run, plan, predict, run

__version__ = "0.1.0"

__all__ = ["Found", "Run", "__version__", "label", "load_run", "plan", "predict", "run"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from apf import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
