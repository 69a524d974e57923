"""Causes of silence that a program's source shows, where nothing crashed: another ROS domain, a loop that waits for ever.

The source explains a finding in words; it never decides one.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import replace

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.session_variables import DOMAIN, leave_domain, set_in
from grader.evidence.text.syntax import code_of, normalise, tree_of

#: Kind of the cause of a program that speaks in another ROS domain.
OTHER_DOMAIN = "other-domain"
#: Kind of the cause of a crash by an attribute of rclpy's Node that a program overwrites.
OVERWRITTEN = "overwritten-attribute"
#: The domain of programs without a choice.
_USUAL = "0"


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
    domains = [] if is_in_graph else list(set_in(tree, DOMAIN))
    for line, value in domains:
        if value == _USUAL:
            continue
        problem = f"The program speaks in ROS domain {value}, and the nodes of this session in another one."
        remedy = leave_domain(f"{path}, line {line}")
        return Diagnosis(OTHER_DOMAIN, problem, remedy, path, line, subject=value)
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
                if code_of(function) != "time.sleep":
                    sleeps.append(node.lineno)
    return min(sleeps, default=None) if has_rate else None


def corrected(found: Diagnosis, texts: Mapping[str, str]) -> Diagnosis:
    """Return the cause of a crash by the source, where the traceback names another line or cause.

    An attribute of rclpy's Node may have been overwritten. A callback without `return` fails in rclpy, after its end.
    argparse refuses arguments without a traceback.
    """
    if found.kind == "parameter-not-declared":
        return _by_overwritten(found, texts.get(found.file or "", ""))
    if found.kind == "no-response":
        return _by_callback(found, texts)
    if found.kind == "format-of-several":
        return _by_format(found, texts.get(str(found.file), ""))
    if found.kind == "ros-arguments":
        return _by_call(found, texts.get(str(found.file), ""), "parse_args")
    return found


def _by_overwritten(found: Diagnosis, text: str) -> Diagnosis:
    line = _overwrites(text, "_parameters")
    if line is None:
        return found
    problem = "self._parameters replaces the attribute in which rclpy's Node keeps its parameters: declared ones are lost."
    remedy = "Give the attribute another name, for instance self._my_parameters."
    return Diagnosis(OVERWRITTEN, problem, remedy, found.file, line, subject=found.subject)


def _by_call(found: Diagnosis, text: str, function: str) -> Diagnosis:
    """Return the line of the first call of a function, if there is one."""
    tree = tree_of(normalise(text))
    if tree is None:
        return found
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _is_named(node.func, function):
            lines.append(node.lineno)
    return replace(found, line=min(lines, default=None))


def _by_format(found: Diagnosis, text: str) -> Diagnosis:
    """Return the line that assigns the only formatted name of the traceback's line, if there is one."""
    tree = tree_of(normalise(text))
    if tree is None:
        return found
    if found.line is None:
        return found
    names: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.FormattedValue(value=ast.Name(id=name), format_spec=ast.JoinedStr()):
                if node.lineno == found.line:
                    names.add(name)
    if len(names) != 1:
        return found
    name = names.pop()
    line = _assigned_before(tree, name, found.line)
    if line is None:
        return found
    problem = (
        f"{name} of line {line} holds several numbers, and line {found.line} formats it as one."
    )
    remedy = (
        f"If {name} must be one number, compute one in line {line}, for instance without `axis=`; otherwise format each of "
        "its numbers."
    )
    return Diagnosis(found.kind, problem, remedy, found.file, line, subject=name)


def _assigned_before(tree: ast.Module, name: str, before: int) -> int | None:
    """Return the last line before another one that assigns a name; None without one."""
    lines = []
    for node in ast.walk(tree):
        for target in _targets(node):
            if code_of(target) == name:
                lines.append(target.lineno)
    return max((line for line in lines if line < before), default=None)


def _by_callback(found: Diagnosis, texts: Mapping[str, str]) -> Diagnosis:
    """Return the end of the first service callback that can end without a response; the node's own file comes first."""
    own = found.file or ""
    for path in (own, *sorted(set(texts) - {own})):
        callback = _without_response(texts.get(path, ""))
        if callback is not None:
            name, line = callback
            problem = f"{name}() ends here without `return response`."
            return replace(found, problem=problem, file=path, line=line, subject=name)
    return found


def _without_response(text: str) -> tuple[str, int] | None:
    """Return the first service callback that can end without a value, and its last line; None without one."""
    tree = tree_of(normalise(text)) if "create_service" in text else None
    if tree is None:
        return None
    callbacks: set[str] = set()
    for node in ast.walk(tree):
        callbacks |= _service_callbacks(node)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name in callbacks and not _gives(node.body):
            return node.name, node.body[-1].end_lineno or node.lineno
    return None


def _service_callbacks(node: ast.AST) -> set[str]:
    """Return the name of the function that a call of `create_service` gets; empty for another node."""
    if not isinstance(node, ast.Call) or not code_of(node.func).endswith("create_service"):
        return set()
    given = list(node.args[2:3])
    for keyword in node.keywords:
        if keyword.arg == "callback":
            given.append(keyword.value)
    return {code_of(each).rpartition(".")[2] for each in given}


def _gives(body: Sequence[ast.stmt]) -> bool:
    """Return whether statements end by returning a value or by raising, on each way through them."""
    last = body[-1] if body else None
    if isinstance(last, ast.Return):
        return last.value is not None
    if isinstance(last, (ast.Raise, ast.While)):
        return True
    ways = _ways(last)
    return bool(ways) and all(map(_gives, ways))


def _ways(statement: ast.stmt | None) -> Sequence[Sequence[ast.stmt]]:
    """Return the blocks of a statement, for its last executed block."""
    match statement:
        case ast.If(body=first, orelse=other):
            return [first, other]
        case ast.With(body=inner):
            return [inner]
        case ast.Try(body=first, handlers=handlers, orelse=other):
            return [other or first, *(handler.body for handler in handlers)]
        case ast.Match(cases=cases):
            return [each.body for each in cases]
    return []


def _overwrites(text: str, attribute: str) -> int | None:
    """Return the first line that assigns to an attribute of `self`, None if none does."""
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    lines = []
    for node in ast.walk(tree):
        for target in _targets(node):
            if code_of(target) == f"self.{attribute}":
                lines.append(target.lineno)
    return min(lines, default=None)


def _targets(node: ast.AST) -> Sequence[ast.expr]:
    if isinstance(node, ast.Assign):
        return node.targets
    if isinstance(node, ast.AnnAssign):
        return [node.target]
    return []


def appended_again(text: str) -> tuple[int, str] | None:
    """Return the first line that appends one object again and again, and the call that appends a copy; None without one.

    The object is an attribute that only __init__ assigns, so that other lines change its contents alone.

    Example
    -------
    After `np.subtract(a, b, out=self.error)`, `self.errors.append(self.error)` needs `self.errors.append(self.error.copy())`.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    assigned: set[str] = set()
    found: list[tuple[int, str, str]] = []
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef) or function.name == "__init__":
            continue
        for node in ast.walk(function):
            assigned.update(map(code_of, _targets(node)))
            found += _appended(node)
    lines = [(line, copying) for line, value, copying in found if value not in assigned]
    return min(lines, default=None)


def _appended(node: ast.AST) -> Sequence[tuple[int, str, str]]:
    """Return the line of a call of `append`, the attribute that it appends, and the call with a copy of that."""
    match node:
        case ast.Call(
            func=ast.Attribute(attr="append") as function, args=[ast.Attribute() as value]
        ):
            name = code_of(value)
            return [(node.lineno, name, f"{code_of(function)}({name}.copy())")]
    return []


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
    return code_of(function).rpartition(".")[2] == name


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
    body = functions.get(code_of(callback).rpartition(".")[2])
    return body is not None and all(map(_is_idle, body))


def _is_idle(statement: ast.stmt) -> bool:
    """Tell whether a statement does nothing, or only prints or logs."""
    match statement:
        case ast.Pass() | ast.Return(value=None) | ast.Expr(ast.Constant()):
            return True
        case ast.Return(ast.Constant()):
            return True
        case ast.Expr(ast.Call(func=function)):
            written = code_of(function)
            return written == "print" or "get_logger()." in written
    return False


def hidden_exception(text: str) -> int | None:
    """Return the line of the first `except` without an effect on any exception, as `except: pass`; None without one.

    A handler of a narrower exception than Exception does not count.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    lines = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.ExceptHandler):
            continue
        if node.type is not None:
            if code_of(node.type) not in ("Exception", "BaseException"):
                continue
        if all(map(_hides, node.body)):
            lines.append(node.lineno)
    return min(lines, default=None)


def _hides(statement: ast.stmt) -> bool:
    match statement:
        case ast.Pass() | ast.Continue() | ast.Return(value=None) | ast.Expr(ast.Constant()):
            return True
    return False


def debug_log(text: str) -> int | None:
    """Return the line of the first call of a logger's debug(); None without one.

    At rclpy's usual level, info, `self.get_logger().debug("...")` prints nothing.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    lines = []
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(attr="debug") as function):
                if code_of(function).endswith("get_logger().debug"):
                    lines.append(node.lineno)
    return min(lines, default=None)


def always_true_parameter(text: str) -> int | None:
    """Return the line of the first condition on a parameter's object in place of its value; None without one.

    Example: `if self.get_parameter("on"):` is always true, and lacks `.value`.
    """
    tree = tree_of(normalise(text))
    if tree is None:
        return None
    lines = []
    for node in ast.walk(tree):
        for condition in _conditions(node):
            match condition:
                case ast.Call(func=ast.Attribute(attr="get_parameter")):
                    lines.append(condition.lineno)
    return min(lines, default=None)


def _conditions(node: ast.AST) -> Sequence[ast.expr]:
    """Return the conditions of a node."""
    match node:
        case ast.If(test=test) | ast.IfExp(test=test) | ast.While(test=test):
            return [test]
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return [operand]
        case ast.BoolOp(values=values):
            return values
    return []


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
