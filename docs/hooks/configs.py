"""The page of configs: each group, option, key, default and comment in conf/, with what its settings class allows.

The comments in the YAML files are the documentation: this module only lays them out.
"""

import enum
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import yaml
from hydra.utils import get_object

from apf.schema import Config

ROOTS = (
    ("config", "One run", "python -m apf.main"),
    ("plan", "A plan for your own objects", "python -m apf.plan"),
    ("predict", "Chances of your own plans", "python -m apf.predict"),
    ("label", "Labels of your own plans", "python -m apf.label"),
    ("relabel", "A corrected label", "python -m apf.relabel"),
    ("show", "A film of the robot", "python -m apf.panda.show"),
    ("sheets", "Markers to print", "python -m apf.panda.sheets"),
)
"""Configs that a command composes: file, title, command."""
HEADER = re.compile(r"^# @package _global_\n", re.MULTILINE)
DOCUMENTED = ("apf.acquisition.", "apf.models.", "apf.packing.", "apf.planning.", "apf.towers.", "apf.domain.")
"""Where classes lie that have a place in the pages of the API."""
BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
PLAIN = {
    int: "whole number",
    float: "number",
    bool: "`true` or `false`",
    str: "text",
    Any: "anything",
    NoneType: "`null`",
}


@dataclass(frozen=True)
class Row:
    """A key as one types it, its default as it is written, what may stand there, and the comment beside it."""

    key: str
    default: str
    allowed: str
    comment: str


def page_of_configs(repository: Path) -> str:
    """The whole page, in Markdown."""
    conf = repository / "conf"
    parts = [
        "# Configs",
        "Every choice is a *group*: a folder of `conf/`, of which a run takes one *option*, a file in it "
        "(`sampler=greedy`). Every number is a *key* (`training.batch=32`). This page is made from the files of "
        "`conf/` and their comments, and from the classes that check the values. `python -m apf.main --cfg job` "
        "prints the config of a run and stops.",
    ]
    for name, title, command in ROOTS:
        parts += [f"## {title}", f"`{command}`"]
        parts += section(conf / f"{name}.yaml", "", Config if name == "config" else None)
    for group in groups(conf):
        parts.append(f"## Group `{group}`")
        for path in sorted((conf / group).glob("*.yaml")):
            prefix = "+" if group == "experiment" else ""
            parts.append(f"### `{prefix}{group}={path.stem}`")
            parts += section(path, package(path, conf), None)
    parts.append("## Sweeps")
    for path in sorted((repository / "sweeps" / "experiment").glob("*.yaml")):
        parts.append(f"### `-m +experiment={path.stem}`")
        parts += section(path, "", None)
    return "\n\n".join(parts) + "\n"


def groups(conf: Path) -> list[str]:
    """All groups with options, by their names; help pages are left out."""
    folders = sorted({path.parent.relative_to(conf).as_posix() for path in conf.rglob("*.yaml")} - {"."})
    return [folder for folder in folders if folder != "hydra/help"]


def package(path: Path, conf: Path) -> str:
    """The key under which the keys of an option stand."""
    if HEADER.search(path.read_text()):
        return ""
    group = path.parent.relative_to(conf).as_posix()
    parent, _, name = group.rpartition("/")
    follows = parent and (conf / parent / f"{name}.yaml").exists()  # world/noisy/towers.yaml is world=noisy of towers
    return (parent if follows else group).replace("/", ".")


def section(path: Path, prefix: str, cls: Any) -> list[str]:
    """What a file says of itself, and a table of its keys.

    Args:
        path: Of the YAML file.
        prefix: The key under which its keys stand; empty: they are at the root.
        cls: The settings class of the file's root, if it names none.
    """
    text = path.read_text()
    body = HEADER.sub("", text)
    said = " ".join(line.lstrip("# ") for line in _leading(body))
    chosen = _defaults(text)
    table = [f"| `{r.key}` | {r.default} | {r.allowed} | {r.comment} |" for r in rows(text, prefix, cls)]
    head = ["| key | default | allowed | what it is |", "|---|---|---|---|"]
    return [part for part in (said, "\n".join(chosen), "\n".join(head + table) if table else "") if part]


def _defaults(text: str) -> list[str]:
    """A table of the options that a config takes of each group; empty: it takes none."""
    options = []
    for node in next((value.value for key, value in yaml.compose(text).value if key.value == "defaults"), []):
        if isinstance(node, yaml.MappingNode):
            ((key, value),) = node.value
            group = re.sub(r"^(override|optional) /?", "", key.value)
            option = (
                value.value if isinstance(value, yaml.ScalarNode) else ", ".join(item.value for item in value.value)
            )
            if "@_here_" not in group and not group.startswith(
                ("hydra/job_logging", "hydra/hydra_logging", "hydra/help")
            ):
                comment = _cell(_comment(text, key, value, inside=False))
                options.append(f"| `{group}` | `{option}` | {comment} |")
    return ["| group | option | what it is |", "|---|---|---|", *options] if options else []


def rows(text: str, prefix: str = "", cls: Any = None) -> Iterator[Row]:
    """A row for each key of a YAML file, except its defaults list.

    Args:
        text: Of the file.
        prefix: The key under which its keys stand.
        cls: The settings class of the root, if it names none.
    """
    yield from _walk(yaml.compose(text), text, prefix, cls)


def _walk(node: yaml.Node | None, text: str, prefix: str, cls: Any, flow: bool = False) -> Iterator[Row]:
    if not isinstance(node, yaml.MappingNode):
        return
    values = {key.value: value for key, value in node.value}
    if "_target_" in values and not values["_target_"].value.startswith("hydra_plugins."):
        cls = get_object(values["_target_"].value)
    for key, value in node.value:
        if key.value == "defaults":
            continue
        name = f"{prefix}.{key.value}" if prefix else key.value
        inside = isinstance(value, yaml.MappingNode) and bool(value.value)
        words, inner = _field(cls, key.value)
        default = "" if inside else _default(key.value, text[value.start_mark.index : value.end_mark.index].strip())
        words = "" if inside else words
        comment = "" if flow else _comment(text, key, value, inside)  # of {a: 1, b: 2} the comment is beside the whole
        yield Row(name, _cell(default), _cell(words), _cell(comment))
        beside = flow or (inside and value.flow_style)
        yield from _walk(value, text, name, inner, beside)


def _default(key: str, text: str) -> str:
    """A value as it is written; the name of a class leads to what the class says of itself."""
    if key == "_target_" and text.startswith(DOCUMENTED):
        cls = get_object(text)
        return f"[`{text}`][{cls.__module__}.{cls.__qualname__}]"
    return f"`{text or 'null'}`"


def _field(cls: Any, key: str) -> tuple[str, Any]:
    """What a settings class allows for a key, in words, and the class of what stands there, if it has keys."""
    if cls is None or key.startswith("_"):
        return "", None
    fields = getattr(cls, "__pydantic_fields__", None)
    if fields is not None:
        if key not in fields:
            return "", None
        annotation, metadata = fields[key].annotation, fields[key].metadata
    else:
        hints = get_type_hints(inspect.unwrap(cls.__init__), include_extras=True)
        if key not in hints:
            return "", None
        annotation, metadata = hints[key], []
    inner = next((kind for kind in (annotation, *get_args(annotation)) if is_dataclass(kind)), None)
    return allowed(annotation, metadata), inner


def allowed(annotation: Any, metadata: Any = ()) -> str:
    """A type and its bounds, in words.

    Args:
        annotation: Of a field.
        metadata: Further bounds beside it.
    """
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return allowed(arguments[0], [*arguments[1:], *metadata])
    bounds = [
        f"{BOUNDS[name]} {_number(getattr(part, name))}"
        for part in _flat(metadata)
        for name in BOUNDS
        if hasattr(part, name)
    ]
    if origin in (Union, UnionType):
        word = " or ".join(dict.fromkeys(allowed(kind) for kind in arguments))
    elif origin is Literal:
        word = ", ".join(f"`{value}`" for value in arguments)
    elif origin in (list, tuple, dict, set, frozenset) or (origin and arguments):
        inner = [kind for kind in arguments if kind is not Ellipsis]
        word = "list: " + ", ".join(dict.fromkeys(allowed(kind) for kind in inner))
    elif inspect.isclass(annotation) and issubclass(annotation, enum.Enum):
        word = ", ".join(f"`{member.value}`" for member in annotation)
    else:
        word = PLAIN.get(annotation, f"`{getattr(annotation, '__name__', annotation)}`")
    return ", ".join([word, *bounds])


def _number(bound: float) -> str:
    """A bound as a person writes it."""
    return f"{bound:,}" if isinstance(bound, int) and bound < 10**9 else f"{bound:g}"


def _flat(metadata: Any) -> Iterator[Any]:
    """Bounds, one by one, of what pydantic keeps beside a type."""
    for part in metadata:
        yield from getattr(part, "metadata", None) or [part]


def _comment(text: str, key: yaml.Node, value: yaml.Node, inside: bool) -> str:
    """The comment beside a key, and the lines of it that follow."""
    lines = text.splitlines()
    last = (
        key.start_mark.line if inside else max(value.end_mark.line - (value.end_mark.column == 0), key.start_mark.line)
    )
    first = re.search(
        r"(?:^|\s)#\s?(.*)$", lines[last][max(key.end_mark.column, 0) if last == key.start_mark.line else 0 :]
    )
    found = [first[1]] if first else []
    for line in lines[last + 1 :]:
        more = re.match(r"^\s{8,}#\s?(.*)$", line)  # a comment that goes on stands below its first line
        if not (more and found):
            break
        found.append(more[1])
    return " ".join(found)


def _leading(text: str) -> Iterator[str]:
    """The comment lines with which a file begins."""
    for line in text.splitlines():
        if not line.startswith("#"):
            return
        yield line


def _cell(text: str) -> str:
    """Text for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")
