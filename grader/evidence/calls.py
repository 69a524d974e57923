"""The rclpy calls in a Python text, with what their literal arguments say.

This is what the source *claims*, where no run of it told. Names that are assigned once, simple arithmetic,
f-strings, loops over literal collections, and functions of the same file are followed; all else is unknown.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from grader.evidence.syntax import normalise, tree_of

STEP_LIMIT = 50_000
"""Expressions that are looked at in one file."""

CASE_LIMIT = 64
"""Ways in which one call in the source may be reached (turns of a loop, calls of its function)."""

DEPTH_LIMIT = 40

_NUMBER_LIMIT = 1e15
_MAIN_GUARD = re.compile(r"^if\s+__name__\s*==\s*['\"]__main__['\"]|^if\s+['\"]__main__['\"]\s*==\s*__name__", re.M)
_MAIN = re.compile(r"^(?:async\s+)?def\s+main\s*\(", re.MULTILINE)
_PARAMETER_VALUES = frozenset(["value", "double_value", "integer_value", "string_value", "bool_value"])
_POLICY = re.compile(r"(?:QoS)?(Reliability|Durability|History|Liveliness)Policy$")
_RMW_PREFIX = re.compile(r"^RMW_QOS_POLICY_(?:RELIABILITY|DURABILITY|HISTORY|LIVELINESS)_")
_POLICY_NUMBERS: dict[str, dict[int, str]] = {
    "reliability": {0: "system_default", 1: "reliable", 2: "best_effort", 4: "best_available"},
    "durability": {0: "system_default", 1: "transient_local", 2: "volatile", 4: "best_available"},
    "history": {0: "system_default", 1: "keep_last", 2: "keep_all"},
    "liveliness": {0: "system_default", 1: "automatic", 3: "manual_by_topic", 4: "best_available"},
}


def _profile(reliability: str, history: str, depth: int, durability: str) -> dict[str, str | int]:
    return {"reliability": reliability, "history": history, "depth": depth, "durability": durability}


_PRESETS: dict[str, dict[str, str | int]] = {
    "default": _profile("reliable", "keep_last", 10, "volatile"),
    "sensor_data": _profile("best_effort", "keep_last", 5, "volatile"),
    "services_default": _profile("reliable", "keep_last", 10, "volatile"),
    "parameters": _profile("reliable", "keep_last", 1000, "volatile"),
    "parameter_events": _profile("reliable", "keep_last", 1000, "volatile"),
    "action_status_default": _profile("reliable", "keep_last", 1, "transient_local"),
    "best_available": _profile("best_available", "keep_last", 10, "best_available"),
    "system_default": _profile("system_default", "system_default", 0, "system_default"),
}
"""The profiles that rclpy brings along, as rclpy 7.1 reports them."""


@dataclass(frozen=True)
class CallFact:
    """One call of rclpy in the source; a call that a loop or several callers reach appears once for each.

    Attributes
    ----------
    kind : str
        "publisher", "subscription", "service", "client", "timer", "parameter" or "node".
    name : str or None
        Name of the topic, service, parameter or node as given in the call; None for a timer or if unknown.
    line : int
        Line of the call.
    qos : mapping or None
        "history", "depth", "reliability", "durability" (and "liveliness" where given) in lower case; policies
        that cannot be told are left out. None where the profile as a whole cannot be told.
    type : str or None
        Name of the interface type as the source spells it, e.g. `Float64MultiArray`.
    callback : str or None
        Bare name of the function that is called back.
    value : object
        Period of a timer in seconds, default of a parameter; None if unknown.
    owner : str or None
        The class around the call.
    """

    kind: str
    name: str | None
    line: int
    qos: Mapping[str, str | int] | None = None
    type: str | None = None
    callback: str | None = None
    value: Any = None
    owner: str | None = None


class _Unknown:
    """The value of what cannot be told."""


_UNKNOWN = _Unknown()


@dataclass(frozen=True)
class _Policy:
    """A member of one of rclpy's policy enumerations, or a preset profile by name."""

    kind: str
    word: str


class _Instance(dict[str, Any]):
    """An object with known fields, told apart from a dictionary of the student's."""


class _Profile(dict[str, Any]):
    """A QoS profile, told apart from a dictionary of the student's."""


_Function = ast.FunctionDef | ast.AsyncFunctionDef
_Bindings = Mapping[str, Any]

_METHODS: dict[str, tuple[str, tuple[str, ...]]] = {
    "create_publisher": ("publisher", ("msg_type", "topic", "qos_profile")),
    "create_lifecycle_publisher": ("publisher", ("msg_type", "topic", "qos_profile")),
    "create_subscription": ("subscription", ("msg_type", "topic", "callback", "qos_profile")),
    "create_service": ("service", ("srv_type", "srv_name", "callback")),
    "create_client": ("client", ("srv_type", "srv_name")),
    "create_timer": ("timer", ("timer_period_sec", "callback")),
    "declare_parameter": ("parameter", ("name", "value")),
    "declare_parameters": ("parameters", ("namespace", "parameters")),
    "create_node": ("node", ("node_name",)),
}


@functools.lru_cache(maxsize=64)
def rclpy_calls(text: str) -> tuple[CallFact, ...]:
    """Calls that make publishers, subscriptions, services, clients, timers, parameters and nodes.

    In the order of their lines; empty for a text that Python refuses.
    """
    tree, _ = tree_of(normalise(text))
    if tree is None:
        return ()
    reader = _Reader(tree)
    facts: list[CallFact] = []
    try:
        for call in reader.calls:
            facts.extend(_facts(reader, call))
    except RecursionError:
        pass
    return tuple(sorted(facts, key=lambda fact: fact.line))


def has_main_guard(text: str) -> bool:
    """Whether running the file as a script does what stands under `if __name__ == "__main__"`."""
    return _MAIN_GUARD.search(normalise(text)) is not None


def defines_main(text: str) -> bool:
    """Whether the module has a function `main`, as an entry point needs it."""
    whole = normalise(text)
    tree, _ = tree_of(whole)
    if tree is None:
        return _MAIN.search(whole) is not None
    return any(isinstance(n, _Function) and n.name == "main" for n in tree.body)


def _facts(reader: _Reader, call: ast.Call) -> Iterator[CallFact]:
    shape = _shape(reader, call)
    if shape is None:
        return
    kind, names = shape
    arguments = _arguments(call, names)
    owner = reader.class_of(call)
    seen: list[CallFact] = []
    for bindings in reader.cases(call):
        for fact in _facts_of_case(reader, kind, arguments, bindings, call.lineno, owner):
            if fact not in seen:
                seen.append(fact)
                yield fact


def _shape(reader: _Reader, call: ast.Call) -> tuple[str, tuple[str, ...]] | None:
    """What the call makes and its positional parameters, None for other calls."""
    function = call.func
    if isinstance(function, ast.Attribute):
        if function.attr in _METHODS:
            return _METHODS[function.attr]
        if function.attr == "__init__" and reader.is_node_class(call):
            explicit = not isinstance(function.value, ast.Call)
            return "node", ("self", "node_name") if explicit else ("node_name",)
    bare = reader.original(function.id) if isinstance(function, ast.Name) else getattr(function, "attr", "")
    keywords = {keyword.arg for keyword in call.keywords}
    if bare in ("Node", "LifecycleNode") and not keywords & {"package", "executable"}:
        return "node", ("node_name",)
    return None


def _arguments(call: ast.Call, names: tuple[str, ...]) -> dict[str, ast.expr]:
    arguments: dict[str, ast.expr] = {}
    for name, argument in zip(names, call.args, strict=False):
        if isinstance(argument, ast.Starred):
            break
        arguments[name] = argument
    arguments.update({keyword.arg: keyword.value for keyword in call.keywords if keyword.arg})
    return arguments


def _facts_of_case(
    reader: _Reader,
    kind: str,
    arguments: Mapping[str, ast.expr],
    bindings: _Bindings,
    line: int,
    owner: str | None,
) -> Iterator[CallFact]:
    def value(name: str) -> Any:
        return reader.value(arguments[name], bindings) if name in arguments else _UNKNOWN

    if kind == "parameters":
        yield from _declared(value("namespace"), value("parameters"), line, owner)
        return
    name = next((value(n) for n in ("topic", "srv_name", "name", "node_name") if n in arguments), _UNKNOWN)
    if kind == "node" and not isinstance(name, str) and not arguments:
        return
    plain = value("value") if kind == "parameter" else value("timer_period_sec") if kind == "timer" else _UNKNOWN
    qos: Any = None
    if "qos_profile" in arguments:
        qos = _as_profile(value("qos_profile"))
    elif kind in ("service", "client"):
        qos = _PRESETS["services_default"]
    yield CallFact(
        kind=kind,
        name=name if isinstance(name, str) else None,
        line=line,
        qos=qos,
        type=_spelling(arguments.get("msg_type") or arguments.get("srv_type"), bindings),
        callback=_spelling(arguments.get("callback"), bindings),
        value=plain if isinstance(plain, (str, int, float, bool, list)) else None,
        owner=owner,
    )


def _declared(namespace: Any, parameters: Any, line: int, owner: str | None) -> Iterator[CallFact]:
    """Parameters of one `declare_parameters`."""
    prefix = f"{namespace}." if isinstance(namespace, str) and namespace else ""
    for item in parameters if isinstance(parameters, (list, tuple)) else ():
        if isinstance(item, (list, tuple)) and item and isinstance(item[0], str):
            plain = item[1] if len(item) > 1 and isinstance(item[1], (str, int, float, bool, list)) else None
            yield CallFact("parameter", prefix + item[0], line, value=plain, owner=owner)


def _as_profile(value: Any) -> Mapping[str, str | int] | None:
    if isinstance(value, _Profile):
        return {key: policy for key, policy in value.items() if isinstance(policy, (str, int))}
    if isinstance(value, int) and not isinstance(value, bool):
        return _profile("reliable", "keep_last", value, "volatile")
    return None


def _spelling(node: ast.expr | None, bindings: _Bindings) -> str | None:
    """The bare name of a type or function."""
    if isinstance(node, ast.Attribute):
        return node.attr
    if isinstance(node, ast.Name):
        bound = bindings.get(node.id)
        return bound.word if isinstance(bound, _Policy) and bound.kind == "name" else node.id
    if isinstance(node, ast.Lambda):
        return "lambda"
    if isinstance(node, ast.Call) and node.args:
        return _spelling(node.args[0], bindings)
    return None


@dataclass
class _Scope:
    """A module, class or function: what is assigned to each name in it."""

    node: ast.AST
    parent: _Scope | None
    assigned: dict[str, list[ast.expr | None]] = field(default_factory=dict)
    attributes: dict[str, dict[str, ast.expr]] = field(default_factory=dict)
    items: dict[str, list[tuple[ast.expr, ast.expr]]] = field(default_factory=dict)


class _Reader:
    """Evaluates expressions of one tree as far as they are literal."""

    def __init__(self, tree: ast.Module) -> None:
        self.steps = STEP_LIMIT
        self.calls: list[ast.Call] = []
        self._parent: dict[ast.AST, ast.AST] = {}
        self._scope: dict[ast.AST, _Scope] = {}
        self._functions: dict[str, list[_Function]] = {}
        self._callers: dict[str, list[ast.Call]] = {}
        self._classes: dict[str, ast.ClassDef] = {}
        self._returns: dict[_Function, list[ast.Return]] = {}
        self._aliases: dict[str, str] = {}
        self._module = _Scope(tree, None)
        self._index(tree)

    def _index(self, tree: ast.Module) -> None:
        stack: list[tuple[ast.AST, _Scope]] = [(tree, self._module)]
        while stack:
            node, scope = stack.pop()
            self._scope[node] = scope
            self._note(node, scope)
            inner = scope
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)):
                inner = _Scope(node, scope)
            for child in reversed(list(ast.iter_child_nodes(node))):
                self._parent[child] = node
                stack.append((child, inner))

    def _note(self, node: ast.AST, scope: _Scope) -> None:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                self._note_target(target, node.value, scope)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            self._note_target(node.target, node.value, scope)
        elif isinstance(node, ast.AugAssign):
            self._note_target(node.target, None, scope)
        elif isinstance(node, _Function):
            self._functions.setdefault(node.name, []).append(node)
        elif isinstance(node, ast.ClassDef):
            self._classes[node.name] = node
        elif isinstance(node, ast.ImportFrom):
            self._aliases.update({alias.asname: alias.name for alias in node.names if alias.asname})
        elif isinstance(node, ast.Call):
            self.calls.append(node)
            self._callers.setdefault(_called(node), []).append(node)

    def _note_target(self, target: ast.expr, value: ast.expr | None, scope: _Scope) -> None:
        if isinstance(target, ast.Name):
            scope.assigned.setdefault(target.id, []).append(value)
        elif isinstance(target, (ast.Tuple, ast.List)):
            values: list[ast.expr | None] = [None] * len(target.elts)
            if isinstance(value, (ast.Tuple, ast.List)) and len(value.elts) == len(target.elts):
                values = list(value.elts)
            for part, part_value in zip(target.elts, values, strict=True):
                self._note_target(part, part_value, scope)
        elif isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name):
            if target.value.id == "self":
                self._class_scope(scope).assigned.setdefault(f"self.{target.attr}", []).append(value)
            elif value is not None:
                scope.attributes.setdefault(target.value.id, {})[target.attr] = value

        elif isinstance(target, ast.Subscript) and value is not None:
            holder = target.value
            own = isinstance(holder, ast.Attribute) and _bare(holder.value) == "self"
            place = self._class_scope(scope) if own else scope
            name = f"self.{_bare(holder)}" if own else _bare(holder)
            place.items.setdefault(name, []).append((target.slice, value))

    def _class_scope(self, scope: _Scope) -> _Scope:
        place: _Scope | None = scope
        while place is not None and not isinstance(place.node, ast.ClassDef):
            place = place.parent
        return place or self._module

    def original(self, name: str) -> str:
        """The name under which something was imported, before `as`."""
        return self._aliases.get(name, name)

    def class_of(self, node: ast.AST) -> str | None:
        """Name of the class around `node`."""
        holder = self._class_scope(self._scope[node]).node
        return holder.name if isinstance(holder, ast.ClassDef) else None

    def is_node_class(self, node: ast.AST) -> bool:
        """Whether the class around `node` is derived from one of a name that ends in Node."""
        holder = self._class_scope(self._scope[node]).node
        bases = holder.bases if isinstance(holder, ast.ClassDef) else []
        return any(self.original(_bare(base)).endswith("Node") for base in bases)

    # -- how a call is reached -------------------------------------------------------------------------

    def cases(self, node: ast.AST, depth: int = 0) -> list[_Bindings]:
        """Values of loop variables and parameters around `node`, one mapping for each way to reach it."""
        self.steps -= 1
        if self.steps < 0:
            return [{}]
        loops: list[ast.For | ast.AsyncFor | ast.comprehension] = []
        place = node
        while place in self._parent:
            place = self._parent[place]
            if isinstance(place, (ast.For, ast.AsyncFor)):
                loops.append(place)
            elif isinstance(place, (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)):
                loops.extend(reversed(place.generators))
            elif isinstance(place, (ast.FunctionDef, ast.AsyncFunctionDef)):
                break
        cases = self._callers_cases(place, depth) if isinstance(place, _Function) else [{}]
        for loop in reversed(loops):
            turned = [turn for case in cases for turn in self._turns(loop, case)]
            cases = turned[:CASE_LIMIT]
        return cases

    def _callers_cases(self, function: ast.AST, depth: int) -> list[_Bindings]:
        """What the parameters of `function` are bound to by each call of it in this file."""
        if not isinstance(function, _Function) or depth > 3:
            return [{}]
        names = [a.arg for a in [*function.args.posonlyargs, *function.args.args]]
        is_initialiser = function.name == "__init__"
        is_ambiguous = len(self._functions.get(function.name, ())) != 1 and not is_initialiser
        if not names or names == ["self"] or is_ambiguous:
            return [{}]
        key = (self.class_of(function) or "") if is_initialiser else function.name
        cases: list[_Bindings] = []
        for call in self._callers.get(key, ())[:CASE_LIMIT]:
            cases.extend(self._bound(function, call, case) for case in self.cases(call, depth + 1))
        return cases[:CASE_LIMIT] or [self._bound(function, None, {})]

    def _bound(self, function: _Function, call: ast.Call | None, case: _Bindings) -> dict[str, Any]:
        arguments = function.args
        names = [a.arg for a in [*arguments.posonlyargs, *arguments.args]]
        bound: dict[str, Any] = {}
        if arguments.defaults:
            for name, default in zip(names[-len(arguments.defaults) :], arguments.defaults, strict=True):
                bound[name] = self.value(default, {})
        for argument, keyword_default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
            if keyword_default is not None:
                bound[argument.arg] = self.value(keyword_default, {})
        if call is None:
            return bound
        if names and names[0] in ("self", "cls"):
            names = names[1:]
        bound.update(self._spread(call, names, case))
        for name, argument_node in _arguments(call, tuple(names)).items():
            value = self.value(argument_node, case)
            if value is _UNKNOWN and isinstance(argument_node, (ast.Name, ast.Attribute)):
                value = _Policy("name", _bare(argument_node))
            bound[name] = value
        return bound

    def _spread(self, call: ast.Call, names: list[str], case: _Bindings) -> dict[str, Any]:
        """Parameters that a starred last argument fills."""
        if not call.args or not isinstance(call.args[-1], ast.Starred):
            return {}
        items = self.value(call.args[-1].value, case)
        if not isinstance(items, (list, tuple)):
            return {}
        return dict(zip(names[len(call.args) - 1 :], items, strict=False))

    def _turns(self, loop: ast.For | ast.AsyncFor | ast.comprehension, case: _Bindings) -> list[_Bindings]:
        items = self.value(loop.iter, case)
        if isinstance(items, dict) and not isinstance(items, (_Profile, _Instance)):
            items = list(items)
        if not isinstance(items, (list, tuple)):
            return [case]
        turns: list[_Bindings] = []
        for item in items[:CASE_LIMIT]:
            turn = dict(case)
            _bind(loop.target, item, turn)
            turns.append(turn)
        return turns

    # -- values ----------------------------------------------------------------------------------------

    def value(self, node: ast.expr | None, bindings: _Bindings, depth: int = 0) -> Any:
        """What `node` evaluates to, `_UNKNOWN` where that cannot be told."""
        self.steps -= 1
        if node is None or self.steps < 0 or depth > DEPTH_LIMIT:
            return _UNKNOWN
        depth += 1
        if isinstance(node, ast.Constant):
            # Python refuses to write a number of thousands of digits.
            return _UNKNOWN if isinstance(node.value, int) and abs(node.value) > _NUMBER_LIMIT else node.value
        if isinstance(node, ast.Name):
            return self._name(node, bindings, depth)
        if isinstance(node, ast.Attribute):
            return self._attribute(node, bindings, depth)
        if isinstance(node, (ast.List, ast.Tuple)):
            values = [self.value(item, bindings, depth) for item in node.elts[:1000]]
            return values if isinstance(node, ast.List) else tuple(values)
        if isinstance(node, ast.Dict):
            return self._dictionary(node, bindings, depth)
        if isinstance(node, ast.Subscript):
            return self._item(node, bindings, depth)
        if isinstance(node, ast.Call):
            return self._call(node, bindings, depth)
        return self._operation(node, bindings, depth)

    def _name(self, node: ast.Name, bindings: _Bindings, depth: int) -> Any:
        if node.id in bindings:
            return bindings[node.id]
        preset = _preset(self.original(node.id))
        if preset is not None:
            return preset
        scope: _Scope | None = self._scope.get(node, self._module)
        while scope is not None:
            values = scope.assigned.get(node.id)
            if values is not None and (not isinstance(scope.node, ast.ClassDef) or scope is self._scope[node]):
                value = self.value(values[0], bindings, depth) if len(values) == 1 else _UNKNOWN
                return self._amended(value, scope, node.id, bindings, depth)
            scope = scope.parent
        return _UNKNOWN

    def _amended(self, value: Any, scope: _Scope, name: str, bindings: _Bindings, depth: int) -> Any:
        """A profile or dictionary with the policies or items that are assigned to it afterwards."""
        if isinstance(value, _Profile):
            amended = _Profile(value)
            for policy, node in scope.attributes.get(name, {}).items():
                _set_policy(amended, policy, self.value(node, bindings, depth))
            return amended
        if not isinstance(value, dict) or name not in scope.items:
            return value
        filled = dict(value)
        for key_node, item_node in scope.items[name][:CASE_LIMIT]:
            key = self.value(key_node, bindings, depth)
            if isinstance(key, (str, int)):
                filled[key] = self.value(item_node, bindings, depth)
        return filled

    def _attribute(self, node: ast.Attribute, bindings: _Bindings, depth: int) -> Any:
        policy = _POLICY.match(self.original(_bare(node.value)))
        if policy is not None:
            return _Policy(policy[1].lower(), _RMW_PREFIX.sub("", node.attr).lower())
        if self.original(_bare(node.value)) == "QoSPresetProfiles":
            return _preset(f"qos_profile_{node.attr.lower()}") or _UNKNOWN
        if (preset := _preset(node.attr)) is not None:
            return preset
        if isinstance(node.value, ast.Name) and node.value.id in ("self", self.class_of(node)):
            holder = self._class_scope(self._scope[node])
            values = holder.assigned.get(f"self.{node.attr}") or holder.assigned.get(node.attr) or []
            value = self.value(values[0], bindings, depth) if len(values) == 1 else _UNKNOWN
            return self._amended(value, holder, f"self.{node.attr}", bindings, depth)
        if node.attr in _PARAMETER_VALUES and isinstance(node.value, ast.Call):
            return self._parameter(node.value, bindings, depth)
        inner = self.value(node.value, bindings, depth)
        if isinstance(inner, _Profile):
            return inner if node.attr == "value" else inner.get(node.attr, _UNKNOWN)
        return inner.get(node.attr, _UNKNOWN) if isinstance(inner, _Instance) else _UNKNOWN

    def _parameter(self, call: ast.Call, bindings: _Bindings, depth: int) -> Any:
        """Default of the parameter that `call` declares or gets."""
        if _called(call) == "get_parameter_value" and isinstance(call.func, ast.Attribute):
            holder = call.func.value
            return self._parameter(holder, bindings, depth) if isinstance(holder, ast.Call) else _UNKNOWN
        if _called(call) == "get_parameter" and call.args:
            name = self.value(call.args[0], bindings, depth)
            declared = [
                c
                for c in self._callers.get("declare_parameter", ())[:CASE_LIMIT]
                if len(c.args) > 1 and self.value(c.args[0], {}, depth) == name
            ]
            return self.value(declared[0].args[1], {}, depth) if len(declared) == 1 else _UNKNOWN
        if _called(call) == "declare_parameter" and len(call.args) > 1:
            return self.value(call.args[1], bindings, depth)
        return _UNKNOWN

    def _instance(self, holder: ast.ClassDef, call: ast.Call, bindings: _Bindings, depth: int) -> Any:
        """An object of a class of the file that has fields only, as a dataclass or a named tuple."""
        names = [
            statement.target.id
            for statement in holder.body
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)
        ]
        if not names:
            return _UNKNOWN
        arguments = _arguments(call, tuple(names))
        return _Instance({name: self.value(value, bindings, depth) for name, value in arguments.items()})

    def _dictionary(self, node: ast.Dict, bindings: _Bindings, depth: int) -> Any:
        result: dict[Any, Any] = {}
        for key_node, value_node in zip(node.keys[:1000], node.values, strict=False):
            key = self.value(key_node, bindings, depth)
            if not isinstance(key, (str, int, float, bool)):
                return _UNKNOWN
            result[key] = self.value(value_node, bindings, depth)
        return result

    def _item(self, node: ast.Subscript, bindings: _Bindings, depth: int) -> Any:
        holder = self.value(node.value, bindings, depth)
        key = self.value(node.slice, bindings, depth)
        try:
            if isinstance(holder, (dict, list, tuple)) and isinstance(key, (str, int)):
                return holder[key]  # type: ignore[index,call-overload,unused-ignore]
        except (KeyError, IndexError, TypeError):
            pass
        return _UNKNOWN

    def _call(self, node: ast.Call, bindings: _Bindings, depth: int) -> Any:
        name = self.original(_called(node))
        if name == "QoSProfile":
            return self._profile_call(node, bindings, depth)
        if name == "get_from_short_key" and node.args:
            key = self.value(node.args[0], bindings, depth)
            policy = _POLICY.match(self.original(_bare(getattr(node.func, "value", node))))
            return _Policy(policy[1].lower(), key) if policy and isinstance(key, str) else _UNKNOWN
        if isinstance(node.func, ast.Attribute) and name in ("items", "keys", "values") and not node.args:
            holder = self.value(node.func.value, bindings, depth)
            return list(getattr(holder, name)()) if isinstance(holder, dict) else _UNKNOWN
        if name in ("list", "tuple", "float", "int", "str", "copy", "deepcopy", "enumerate", "sorted"):
            return self._builtin(name, node, bindings, depth)
        if name == "dict" and not node.args:
            return {k.arg: self.value(k.value, bindings, depth) for k in node.keywords if k.arg}
        if name in self._classes:
            return self._instance(self._classes[name], node, bindings, depth)
        functions = self._functions.get(name, [])
        if len(functions) == 1 and depth < DEPTH_LIMIT:
            returns = self._returns_of(functions[0])
            if len(returns) == 1:
                return self.value(returns[0].value, self._bound(functions[0], node, bindings), depth + 5)
        return _UNKNOWN

    def _returns_of(self, function: _Function) -> list[ast.Return]:
        if function not in self._returns:
            self._returns[function] = [n for n in ast.walk(function) if isinstance(n, ast.Return)]
        return self._returns[function]

    def _builtin(self, name: str, node: ast.Call, bindings: _Bindings, depth: int) -> Any:
        value = self.value(node.args[0], bindings, depth) if node.args else _UNKNOWN
        if name in ("copy", "deepcopy"):
            return value
        if name in ("list", "tuple", "enumerate", "sorted"):
            items = list(value) if isinstance(value, (list, tuple, dict)) else None
            return _UNKNOWN if items is None else list(enumerate(items)) if name == "enumerate" else items
        if isinstance(value, (int, float)) and abs(value) < _NUMBER_LIMIT:
            return {"float": float, "int": int, "str": str}[name](value)
        return value if name == "str" and isinstance(value, str) else _UNKNOWN

    def _profile_call(self, node: ast.Call, bindings: _Bindings, depth: int) -> Any:
        given: dict[str, Any] = {}
        for keyword in node.keywords:
            value = self.value(keyword.value, bindings, depth)
            if keyword.arg is not None:
                given[keyword.arg] = value
            elif isinstance(value, dict):
                given.update({key: v for key, v in value.items() if isinstance(key, str)})
            else:
                return _UNKNOWN
        profile = _Profile(_PRESETS["default"])
        for name, value in given.items():
            _set_policy(profile, name, value)
        return profile

    def _operation(self, node: ast.expr, bindings: _Bindings, depth: int) -> Any:
        if isinstance(node, ast.JoinedStr):
            return self._joined(node, bindings, depth)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            operand = self.value(node.operand, bindings, depth)
            if isinstance(operand, (int, float)):
                return -operand if isinstance(node.op, ast.USub) else +operand
        if isinstance(node, ast.BinOp):
            left = self.value(node.left, bindings, depth)
            right = self.value(node.right, bindings, depth)
            return _arithmetic(node.op, left, right)
        if isinstance(node, ast.DictComp):
            return self._comprehended(node, bindings, depth)
        return _UNKNOWN

    def _joined(self, node: ast.JoinedStr, bindings: _Bindings, depth: int) -> Any:
        pieces: list[str] = []
        for part in node.values[:100]:
            inner = part.value if isinstance(part, ast.FormattedValue) else part
            value = self.value(inner, bindings, depth)
            if not isinstance(value, (str, int, float)) or getattr(part, "format_spec", None) is not None:
                return _UNKNOWN
            pieces.append(str(value)[:1000])
        return "".join(pieces)[:1000]

    def _comprehended(self, node: ast.DictComp, bindings: _Bindings, depth: int) -> Any:
        cases: list[_Bindings] = [bindings]
        for generator in node.generators:
            cases = [turn for case in cases for turn in self._turns(generator, case)][:CASE_LIMIT]
        result: dict[Any, Any] = {}
        for case in cases:
            key = self.value(node.key, case, depth)
            if not isinstance(key, (str, int)):
                return _UNKNOWN
            result[key] = self.value(node.value, case, depth)
        return result


def _bare(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _called(node: ast.Call) -> str:
    return _bare(node.func)


def _preset(name: str) -> _Profile | None:
    if not name.startswith("qos_profile_"):
        return None
    policies = _PRESETS.get(name.removeprefix("qos_profile_"))
    return None if policies is None else _Profile(policies)


def _set_policy(profile: _Profile, name: str, value: Any) -> None:
    """Set one policy as rclpy would; one that cannot be told is taken out."""
    if name == "depth":
        known = isinstance(value, int) and not isinstance(value, bool)
        profile.update({"depth": value}) if known else profile.pop("depth", None)
    elif name in _POLICY_NUMBERS:
        word = value.word if isinstance(value, _Policy) and value.kind == name else None
        if isinstance(value, int):
            word = _POLICY_NUMBERS[name].get(value)
        elif isinstance(value, str) and value in _POLICY_NUMBERS[name].values():
            word = value
        profile.update({name: word}) if word else profile.pop(name, None)


def _bind(target: ast.expr, item: Any, turn: dict[str, Any]) -> None:
    if isinstance(target, ast.Name):
        turn[target.id] = item
    elif isinstance(target, (ast.Tuple, ast.List)):
        parts = list(item) if isinstance(item, (tuple, list)) and len(item) == len(target.elts) else None
        for index, part in enumerate(target.elts):
            _bind(part, _UNKNOWN if parts is None else parts[index], turn)


def _arithmetic(operator: ast.operator, left: Any, right: Any) -> Any:
    if isinstance(left, str) and isinstance(right, str) and isinstance(operator, ast.Add):
        return (left + right)[:1000]
    if isinstance(left, dict) and isinstance(right, dict) and isinstance(operator, ast.BitOr):
        return {**left, **right}
    if isinstance(left, list) and isinstance(right, int) and isinstance(operator, ast.Mult):
        return left * right if 0 <= len(left) * right <= 1000 else _UNKNOWN
    if not (isinstance(left, (int, float)) and isinstance(right, (int, float))):
        return _UNKNOWN
    if abs(left) > _NUMBER_LIMIT or abs(right) > _NUMBER_LIMIT:
        return _UNKNOWN
    if isinstance(operator, (ast.Div, ast.FloorDiv, ast.Mod)) and right == 0:
        return _UNKNOWN
    operations: dict[type[ast.operator], Any] = {
        ast.Add: lambda: left + right, ast.Sub: lambda: left - right, ast.Mult: lambda: left * right,
        ast.Div: lambda: left / right, ast.FloorDiv: lambda: left // right, ast.Mod: lambda: left % right,
        ast.Pow: lambda: left**right if 0 < abs(left) < 1e4 and abs(right) <= 6 else _UNKNOWN,
    }  # fmt: skip
    return operations.get(type(operator), lambda: _UNKNOWN)()
