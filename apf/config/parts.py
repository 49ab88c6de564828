"""What a config names by `_target_`: which classes it may name, and how objects are made of them.

A config may come with somebody else's run directory. So a `_target_` can name a class only, and only one that is
derived from the class that its place asks for, as the annotations of the settings say. All of a config is checked
before anything of it is called.
"""

import functools
import importlib
import inspect
import re
import sys
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from importlib.metadata import packages_distributions, requires
from importlib.util import find_spec
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import pydantic

from apf.errors import InputError, shown
from apf.settings import strict

TARGET, PARTIAL = "_target_", "_partial_"
OURS = "apf"
"""This package."""
MADE_FOR_APF = re.compile(r"^\s*(?:from|import)\s+apf\b", re.MULTILINE)
REQUIRES_APF = re.compile(r"apf(?![\w.-])", re.IGNORECASE)


@dataclass(frozen=True)
class Part:
    """A mapping of a config that names a class.

    key: where it stands. values: what the class is given. partial: is it left to others to call it?
    """

    key: str
    cls: type
    values: dict[str, Any]
    partial: bool


class PartError(Exception):
    """A class, found at `key`, did not take its values; the cause says why."""

    def __init__(self, key: str) -> None:
        super().__init__(key)
        self.key = key


def find(node: Any, hints: Sequence[Any], key: str = "") -> Any:
    """The plain config `node` with a `Part` for each mapping that names a class. Calls nothing.

    Args:
        node: Plain containers and values.
        hints: The types that its place asks for, any of them; none: it asks for plain values.
        key: Where it stands in the config.

    Raises:
        InputError: A class is not there, or is none that its place asks for.
    """
    hints = [alternative for hint in hints for alternative in _alternatives(hint)]
    if isinstance(node, list | tuple):
        items = [argument for hint in hints if _is_list(hint) for argument in get_args(hint)]
        return [find(item, items, f"{key}.{i}" if key else str(i)) for i, item in enumerate(node)]
    if not isinstance(node, Mapping):
        return node
    known = (TARGET, PARTIAL) if key else ()  # Hydra's other special keys say how to call: that is not left to a config
    for name in node:
        if re.fullmatch(r"_\w+_", str(name)) and name not in known:
            raise InputError(f"{_join(key, name)}: there is no such key")
    if TARGET in node:
        return _find_part(node, hints, key)
    if PARTIAL in node:
        raise InputError(f"{_join(key, PARTIAL)}: it goes with a {TARGET}")
    values = [get_args(hint)[1] for hint in hints if _is_mapping(hint)]
    fields = [_fields(hint) for hint in hints if isinstance(hint, type) and is_dataclass(hint)]
    return {
        name: find(value, [*values, *(f[name] for f in fields if name in f)], _join(key, name))
        for name, value in node.items()
    }


def make(found: Any) -> Any:
    """What `find` found, with each class called. Raises PartError if one does not take its values."""
    if isinstance(found, list):
        return [make(item) for item in found]
    if isinstance(found, Mapping):
        return {name: make(value) for name, value in found.items()}
    if not isinstance(found, Part):
        return found
    values = make(found.values)
    try:
        if found.partial:
            return functools.partial(found.cls, **_checked(found.cls, values))
        return found.cls(**values)
    except Exception as error:
        raise PartError(found.key) from error


def _find_part(node: Mapping[str, Any], hints: Sequence[Any], key: str) -> Part:
    where = _join(key, TARGET)
    target, partial = node[TARGET], node.get(PARTIAL, False)
    later = [hint for hint in hints if get_origin(hint) is Callable]
    if not isinstance(partial, bool):
        raise InputError(f"{_join(key, PARTIAL)} is {shown(partial)}; it must be true or false")
    asked = [a for hint in later for a in _alternatives(get_args(hint)[-1])] if partial else hints
    bases = tuple(hint for hint in asked if isinstance(hint, type) and _is_made_for_apf(hint.__module__))
    if not bases:
        if partial and hints and not later:
            raise InputError(f"{_join(key, PARTIAL)} is true; here it must be false, or left out")
        if later and not partial:
            raise InputError(f"{_join(key, PARTIAL)} must be true: the class is called later, when sizes are known")
        raise InputError(f"{where} is {target}; no class can be chosen here")
    cls = _locate(target, where)
    if not (isinstance(cls, type) and issubclass(cls, bases)):
        names = " or ".join(f"{base.__module__.partition('._')[0]}.{base.__qualname__}" for base in bases)
        raise InputError(f"{where} is {target}; it must be a class that is, or is derived from, {names}")
    fields = _fields(cls)
    values = {
        name: find(value, [fields[name]] if name in fields else [], _join(key, name))
        for name, value in node.items()
        if name not in (TARGET, PARTIAL)
    }
    return Part(key, cls, values, partial)


def _locate(target: Any, where: str) -> Any:
    """What a dotted name stands for. Raises InputError if there is no such thing, or it must not be imported."""
    if not (isinstance(target, str) and re.fullmatch(r"[^\W\d]\w*(\.[^\W\d]\w*)+", target)):
        raise InputError(f"{where} is {shown(target)}; it must be MODULE.CLASS")
    names = target.split(".")
    _check_import(names[0], f"{where} is {target}")
    found: Any = None
    for i, name in enumerate(names):
        module = ".".join(names[: i + 1])
        try:  # a module may import what it offers when it is asked for it
            if found is not None and hasattr(found, name):
                found = getattr(found, name)
            elif found is None or inspect.ismodule(found):
                found = importlib.import_module(module)
            else:
                raise ModuleNotFoundError(name=module)
        except ModuleNotFoundError as error:
            if error.name != module:  # something that the module needs
                raise InputError(f"{where} is {target}; {error}") from None
            raise InputError(f"{where} is {target}; {'.'.join(names[:i])} has no {name}") from None
        except ImportError as error:
            raise InputError(f"{where} is {target}; {error}") from None
        except Exception as error:
            raise InputError(f"{where} is {target}; {module} fails: {type(error).__name__}: {error}") from error
    return found


def _check_import(package: str, what: str) -> None:
    """Raises InputError unless a package is there and made for this one: whatever else is installed stays unread."""
    if package == OURS:
        return
    if package not in sys.stdlib_module_names and _find_spec(package) is None:
        raise InputError(f"{what}; there is no module {package}, neither installed nor in {Path.cwd()}")
    if not _is_made_for_apf(package):
        raise InputError(
            f"{what}; {package} is not made for apf: it has to import apf or, if pip installed it, to require it"
        )


@functools.cache
def _is_made_for_apf(module: str) -> bool:
    """Is the module's package this one, an installed one that requires it, or a loose one whose source imports it?"""
    package = module.partition(".")[0]
    if package == OURS:
        return True
    spec = None if package in sys.stdlib_module_names else _find_spec(package)
    if spec is None:
        return False
    distributions = packages_distributions().get(package, [])
    if distributions:
        return OURS in distributions or any(
            REQUIRES_APF.match(text) for name in distributions for text in requires(name) or []
        )
    return any(MADE_FOR_APF.search(text) for text in _sources(spec))


def _find_spec(package: str) -> Any:
    try:
        return find_spec(package)
    except (ImportError, ValueError):  # ValueError: a module without a spec, as __main__
        return None


def _sources(spec: Any) -> Iterator[str]:
    folders = spec.submodule_search_locations or []
    paths = [path for folder in folders for path in Path(folder).rglob("*.py")] or [Path(spec.origin or "")]
    for path in paths:
        if path.suffix == ".py" and path.is_file():
            yield path.read_text(encoding="utf-8", errors="replace")


def _alternatives(hint: Any) -> list[Any]:
    """A type without what annotates it, or, of a union, each of its types."""
    if get_origin(hint) is Annotated:
        return _alternatives(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        return [alternative for argument in get_args(hint) for alternative in _alternatives(argument)]
    if isinstance(hint, TypeVar):
        return []
    return [hint]


def _is_list(hint: Any) -> bool:
    return isinstance(get_origin(hint), type) and issubclass(get_origin(hint), Sequence)


def _is_mapping(hint: Any) -> bool:
    return isinstance(get_origin(hint), type) and issubclass(get_origin(hint), Mapping)


def _fields(cls: type) -> dict[str, Any]:
    """The type of each thing that a class is made with, as far as its annotations tell."""
    source: Any = cls if is_dataclass(cls) else cls.__init__  # type: ignore[misc]
    try:
        return typing.get_type_hints(source, include_extras=True)
    except (NameError, TypeError):  # of somebody's own class: a type that is imported for type checkers only
        return {}


def _checked(cls: type, values: dict[str, Any]) -> dict[str, Any]:
    """Values for a class that is called later, as its annotations have them."""
    fields = {name: hint for name, hint in _fields(cls).items() if name in values and not name.startswith("_")}
    configured = {name: (strict(hint), ...) for name, hint in fields.items()}
    config = pydantic.ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False)
    model: Any = pydantic.create_model(cls.__name__, __config__=config, **configured)  # type: ignore[call-overload]
    checked = model(**{name: values[name] for name in fields})
    return values | {name: getattr(checked, name) for name in fields}


def _join(key: str, name: Any) -> str:
    return f"{key}.{name}" if key else str(name)
