"""Small mistakes that one could make in a source file: its mutants, one change each, on the syntax tree."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
PAIRS = (
    ("min", "max"),
    ("any", "all"),
    ("minimum", "maximum"),
    ("argmin", "argmax"),
    ("zeros", "ones"),
    ("zeros_like", "ones_like"),
    ("sum", "prod"),
    ("cumsum", "cumprod"),
    ("ceil", "floor"),
    ("logical_and", "logical_or"),
)
NAMES = dict(PAIRS) | {second: first for first, second in PAIRS} | {"mean": "sum", "reversed": "list"}
"""Functions and methods that are taken for one another."""

CONDITIONS = (ast.If, ast.IfExp, ast.While, ast.comprehension)


@dataclass(frozen=True)
class Mutant:
    """One change: in place of `parent.field` (or of its item `index`) stands `new`; `before` and `after` are the line
    that it changes, as Python writes it."""

    line: int
    before: str
    after: str
    parent: ast.AST
    field: str
    index: int | None
    new: ast.AST

    def apply(self) -> None:
        """Change the tree that the mutant was found in."""
        _put(self.parent, self.field, self.index, self.new)


def mutants(tree: ast.Module) -> list[Mutant]:
    """All mutants of a module, in the order of the source.

    Left alone: docstrings, types, decorators, what an error says, `__all__`, and `strict=` (which only guards).
    """
    found = []
    for parent, field, index, node, statement in _nodes(tree, tree):
        for new in _replacements(parent, field, node):
            ast.fix_missing_locations(ast.copy_location(new, node))
            whole = statement if statement is not node else None
            before = ast.unparse(whole or node).splitlines()
            _put(parent, field, index, new)
            after = ast.unparse(whole or new).splitlines()
            _put(parent, field, index, node)
            lines = next((pair for pair in zip(before, after, strict=False) if pair[0] != pair[1]), (before[0], ""))
            line = getattr(node, "lineno", getattr(statement, "lineno", 0))
            found.append(Mutant(line, *_shown(*lines), parent, field, index, new))
    return found


def _shown(before: str, after: str) -> tuple[str, str]:
    """Both lines; one that is left out stays as a comment, so that no two lines look the same."""
    before, after = before.strip(), after.strip()
    return before, f"{after}  # {before}" if after in ("pass", "return") else after


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _nodes(node: ast.AST, statement: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, ast.AST, ast.AST]]:
    """Every node below this one that may change: its parent, where it stands in it, itself, and its statement."""
    for field, value in ast.iter_fields(node):
        if field in ("decorator_list", "returns", "keywords") and isinstance(node, ast.ClassDef | ast.FunctionDef):
            continue
        for index, child in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(child, ast.AST) and not _left_alone(node, field, child):
                own = child if isinstance(child, ast.stmt) else statement
                yield node, field, index if isinstance(value, list) else None, child, own
                yield from _nodes(child, own)


def _left_alone(parent: ast.AST, field: str, node: ast.AST) -> bool:
    match node:
        case ast.Expr(ast.Constant()) | ast.Import() | ast.ImportFrom() | ast.JoinedStr() | ast.Pass():
            return True
        case ast.Assign([ast.Name("__all__")]) | ast.keyword("strict"):
            return True
        case ast.ClassDef(bases=bases):
            return any(isinstance(base, ast.Name) and base.id == "Protocol" for base in bases)
    if isinstance(parent, ast.Raise) or (isinstance(parent, ast.arg) and field == "annotation"):
        return True
    return isinstance(parent, ast.AnnAssign) and field == "annotation" and not isinstance(node, ast.Subscript)


def _replacements(parent: ast.AST, field: str, node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.stmt):
        yield from _statements(node)
    if isinstance(node, ast.expr):
        if isinstance(parent, CONDITIONS) and field in ("test", "ifs"):
            yield ast.UnaryOp(ast.Not(), node)
            if not isinstance(parent, ast.While):
                yield from (ast.Constant(True), ast.Constant(False))
        yield from _expressions(node)


def _statements(node: ast.stmt) -> Iterator[ast.AST]:
    """Without the statement, or without what it does around others."""
    match node:
        case ast.Expr(ast.Call()) | ast.Raise() | ast.Break() | ast.Continue() | ast.Delete():
            yield ast.Pass()
        case ast.Assign(targets) if not all(isinstance(target, ast.Name) for target in targets):
            yield ast.Pass()
        case ast.AugAssign(target, _, value):
            yield ast.Pass()
            yield ast.Assign([target], value)
        case ast.Return(value) if value is not None and not (isinstance(value, ast.Constant) and value.value is None):
            yield ast.Return(None)
        case ast.For(target, _, body):
            yield ast.For(target, ast.List([], ast.Load()), body, [])
        case ast.With(items, body) if all(item.optional_vars is None for item in items):
            yield ast.If(ast.Constant(True), body, [])
        case ast.FunctionDef(name, arguments, body) if not _gives(node) and len(body) > 1:
            yield ast.FunctionDef(name, arguments, [ast.Pass()], node.decorator_list)


def _gives(function: ast.FunctionDef) -> bool:
    """Does it return or yield anything?"""
    return any(isinstance(node, ast.Return | ast.Yield | ast.YieldFrom) for node in ast.walk(function))


def _expressions(node: ast.expr) -> Iterator[ast.expr]:
    match node:
        case ast.Compare(left, operators, comparators):
            for i, operator in enumerate(operators):
                for other in COMPARISONS[type(operator)]:
                    yield ast.Compare(left, [*operators[:i], other(), *operators[i + 1 :]], comparators)
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS and not _is_text(left, right):
            yield ast.BinOp(left, OPERATORS[type(operator)](), right)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
            yield from (values[i] for i in range(len(values)))
        case ast.UnaryOp(ast.Not() | ast.USub() | ast.Invert(), operand):
            yield operand
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield from (ast.Constant(value + 1), ast.Constant(value - 1))
        case ast.Constant(str() as value):
            yield ast.Constant(f"{value}?")
        case ast.Subscript(value, index, context):
            yield from (ast.Subscript(value, other, context) for other in _slices(index))
        case ast.Call(function, arguments, keywords):
            yield from _calls(function, arguments, keywords)


def _is_text(*nodes: ast.expr) -> bool:
    return any(
        isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str)) for n in nodes
    )


def _slices(index: ast.expr) -> Iterator[ast.expr]:
    """A slice without its beginning, without its end."""
    match index:
        case ast.Slice(lower, upper, step):
            if lower:
                yield ast.Slice(None, upper, step)
            if upper:
                yield ast.Slice(lower, None, step)
        case ast.Tuple(parts, context):
            for i, part in enumerate(parts):
                yield from (ast.Tuple([*parts[:i], other, *parts[i + 1 :]], context) for other in _slices(part))


def _calls(function: ast.expr, arguments: list[ast.expr], keywords: list[ast.keyword]) -> Iterator[ast.expr]:
    """Another function, or the same without one of its named arguments."""
    match function:
        case ast.Name(name) if name in NAMES:
            yield ast.Call(ast.Name(NAMES[name], ast.Load()), arguments, keywords)
        case ast.Attribute(value, name) if name in NAMES:
            yield ast.Call(ast.Attribute(value, NAMES[name], ast.Load()), arguments, keywords)
    for i, keyword in enumerate(keywords):
        if keyword.arg not in (None, "strict"):
            yield ast.Call(function, arguments, [*keywords[:i], *keywords[i + 1 :]])
