"""Causes of silence that a program's source shows, where nothing crashed: another ROS domain, a loop that waits for ever.

The source explains a finding in words; it never decides one.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.text.syntax import normalise, tree_of

_DOMAIN = "ROS_DOMAIN_ID"
#: Arguments that name a domain.
_KEYWORDS = ("domain_id", _DOMAIN)
#: Longest text of a value that is quoted.
_QUOTED = 40


def silent_cause(path: str, text: str, is_in_graph: bool = False) -> Diagnosis | None:
    """Return why a program that goes on may show nothing; None if its source does not tell.

    A program with a node in the graph speaks in the session's domain, whatever its source sets.

    Examples
    --------
    `os.environ["ROS_DOMAIN_ID"] = "30"` leads to another graph, and `rate.sleep()` in a program that never spins waits
    for ever.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    domains = [] if is_in_graph else list(_domains(tree))
    for line, value in domains:
        problem = f"The program speaks in ROS domain {value}, and the nodes of this session in another one."
        remedy = (
            f"Leave the domain to the terminal: take {_DOMAIN} or domain_id out of the program."
        )
        return Diagnosis("other-domain", problem, remedy, path, line, subject=value)
    sleep = _sleep_without_spin(tree)
    if sleep is None:
        return None
    problem = (
        "sleep() of a rate waits for an executor that spins, and nothing spins in this program."
    )
    remedy = (
        "Do the work in a timer and call rclpy.spin(node), or spin in a thread beside the loop."
    )
    return Diagnosis("rate-without-spin", problem, remedy, path, sleep)


def _domains(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield the line and the value of each ROS domain that a program sets."""
    for node in ast.walk(tree):
        for value in _values(node):
            yield value.lineno, ast.unparse(value).strip("'\"")[:_QUOTED]


def _values(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the ROS domains that a statement or a call sets; None is the default."""
    match node:
        case ast.Assign(targets=[ast.Subscript(slice=ast.Constant(value=name))], value=value):
            if name == _DOMAIN:
                yield value
        case ast.Call(func=ast.Attribute(attr="setdefault" | "putenv"), args=[name, value]):
            if ast.unparse(name) == repr(_DOMAIN):
                yield value
        case ast.Call(keywords=keywords):
            for keyword in keywords:
                if keyword.arg in _KEYWORDS and ast.unparse(keyword.value) != "None":
                    yield keyword.value


def _sleep_without_spin(tree: ast.Module) -> int | None:
    """Return the line of the first sleep of a rate in a program without any name that holds `spin`.

    A thread is given the function, as in `Thread(target=rclpy.spin)`, and does not call it by name.
    """
    has_rate = False
    sleeps = []
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.alias(name=name):
                if "spin" in name:
                    return None
                has_rate |= name == "create_rate"
            case ast.Call(func=ast.Attribute(attr="sleep") as function):
                if ast.unparse(function) != "time.sleep":
                    sleeps.append(node.lineno)
    return min(sleeps, default=None) if has_rate else None


def corrected(found: Diagnosis, text: str) -> Diagnosis:
    """Return the cause of a crash, by the source of its file: an attribute of rclpy's Node may have been overwritten."""
    if found.kind != "parameter-not-declared":
        return found
    line = _overwrites(text, "_parameters")
    if line is None:
        return found
    problem = "self._parameters replaces the attribute in which rclpy's Node keeps its parameters, so that none is declared."
    remedy = "Give the attribute another name, for instance self._my_parameters."
    return replace(found, kind="overwritten-attribute", problem=problem, remedy=remedy, line=line)


def _overwrites(text: str, attribute: str) -> int | None:
    """Return the first line that assigns to an attribute of `self`, None if none does."""
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    lines = []
    for node in ast.walk(tree):
        for target in _targets(node):
            if ast.unparse(target) == f"self.{attribute}":
                lines.append(target.lineno)
    return min(lines, default=None)


def _targets(node: ast.AST) -> Sequence[ast.expr]:
    if isinstance(node, ast.Assign):
        return node.targets
    return [node.target] if isinstance(node, ast.AnnAssign) else []


def idle_callback(text: str) -> int | None:
    """Return the line of the first subscription if no subscription's callback keeps anything of a message; else None.

    A callback keeps nothing if it only passes, returns nothing, prints or logs: `create_subscription(T, "/a", lambda m:
    None, 10)`. None too if the source does not show a callback.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    functions: dict[str, list[ast.stmt]] = {}
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            functions[node.name] = node.body
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not _is_named(node.func, "create_subscription"):
            continue
        if not _keeps_nothing(_callback_of(node), functions):
            return None
        lines.append(node.lineno)
    return min(lines, default=None)


def _is_named(function: ast.expr, name: str) -> bool:
    return ast.unparse(function).rpartition(".")[2] == name


def _callback_of(call: ast.Call) -> ast.expr | None:
    """Return the third argument of a subscription, or the one by its name."""
    for keyword in call.keywords:
        if keyword.arg == "callback":
            return keyword.value
    return call.args[2] if len(call.args) > 2 else None


def _keeps_nothing(callback: ast.expr | None, functions: Mapping[str, Sequence[ast.stmt]]) -> bool:
    """Tell whether a callback that the source shows has no lasting effect."""
    if isinstance(callback, ast.Lambda):
        return _is_idle(ast.Expr(callback.body))
    if not isinstance(callback, ast.Name | ast.Attribute):
        return False
    body = functions.get(ast.unparse(callback).rpartition(".")[2])
    return body is not None and all(map(_is_idle, body))


def _is_idle(statement: ast.stmt) -> bool:
    """Tell whether a statement does nothing, or only prints or logs."""
    match statement:
        case ast.Pass() | ast.Return(value=None) | ast.Expr(ast.Constant()):
            return True
        case ast.Return(ast.Constant()):
            return True
        case ast.Expr(ast.Call(func=function)):
            written = ast.unparse(function)
            return written == "print" or "get_logger()." in written
    return False


def late_lambda(text: str) -> tuple[int, str] | None:
    """Return the line of the first lambda in a loop that uses the loop's variable, and the variable; None without one.

    All such lambdas see the variable's last value: `for name in names: create_subscription(..., lambda m: f(name, m))`.
    A default, as in `lambda m, name=name: ...`, keeps the value.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    found = []
    for loop in ast.walk(tree):
        if isinstance(loop, ast.For):
            names = _names(loop.target, ast.Store)
            for statement in loop.body:
                found += _late(statement, names)
    return min(found, default=None)


def _late(statement: ast.stmt, names: set[str]) -> list[tuple[int, str]]:
    """Return the line and the variable of each lambda that is passed to a call and uses one of the names."""
    found = []
    for call in ast.walk(statement):
        if not isinstance(call, ast.Call):
            continue
        arguments = list(call.args)
        for keyword in call.keywords:
            arguments.append(keyword.value)
        for argument in arguments:
            if isinstance(argument, ast.Lambda):
                for name in _free_names(argument) & names:
                    found.append((argument.lineno, name))
    return found


def _free_names(function: ast.Lambda) -> set[str]:
    """Return the names in the body of a lambda that are not its parameters."""
    own = set()
    for each in ast.walk(function.args):
        if isinstance(each, ast.arg):
            own.add(each.arg)
    return _names(function.body, ast.Load) - own


def _names(tree: ast.AST, context: type[ast.expr_context]) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, context):
            found.add(node.id)
    return found
