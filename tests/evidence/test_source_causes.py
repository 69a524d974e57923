"""Causes that the source of a program shows where nothing crashed."""

from __future__ import annotations

import pytest

from grader.evidence.crash.causes import Diagnosis
from grader.evidence.crash.diagnosis import explain
from grader.evidence.source_causes import (
    always_true_parameter,
    appended_again,
    corrected,
    debug_log,
    hidden_exception,
    late_lambda,
    silent_cause,
)
from grader.recording.session import OutputLine

HEAD = "import os, time\nimport rclpy\n"


@pytest.mark.parametrize(
    ("statement", "value"),
    [
        ("os.environ['ROS_DOMAIN_ID'] = '30'", "30"),
        ("os.environ['ROS_DOMAIN_ID'] = str(bench)", "str(bench)"),
        ("os.putenv('ROS_DOMAIN_ID', '7')", "7"),
        ("os.environ.update(ROS_DOMAIN_ID='8')", "8"),
        ("rclpy.init(args=args, domain_id=42)", "42"),
    ],
)
def test_a_domain_in_the_source_is_named_with_its_line(statement: str, value: str) -> None:
    """Each usual way to choose a ROS domain in a program is seen."""
    found = silent_cause("talk.py", HEAD + statement)
    assert found is not None
    assert (found.kind, found.subject, found.line) == ("other-domain", value, 3)
    assert f"ROS domain {value}," in found.problem


@pytest.mark.parametrize(
    "statement",
    [
        "rclpy.init(args=args, domain_id=None)",
        "rclpy.init(args=args, domain_id=0)",
        "os.environ.setdefault('ROS_DOMAIN_ID', '30')",
        "print(os.environ['ROS_DOMAIN_ID'])",
        "rclpy.init(",
    ],
)
def test_a_domain_that_is_only_read_is_no_cause(statement: str) -> None:
    """Reading the variable, the usual domain, and a value for want of another, leave the program in the session's domain."""
    assert silent_cause("talk.py", HEAD + statement) is None


def test_a_program_in_the_graph_is_in_the_domain_of_the_session() -> None:
    """A node that the session saw cannot speak in another domain, whatever its source sets."""
    text = f"{HEAD}os.environ['ROS_DOMAIN_ID'] = '30'"
    assert silent_cause("talk.py", text, is_in_graph=True) is None


LOOP = """
rate = node.create_rate(100)
while rclpy.ok():
    node.publish()
    rate.sleep()
"""


def test_a_rate_without_spin_is_named_with_the_line_of_its_sleep() -> None:
    """The first sleep never returns, as no executor runs its timer."""
    found = silent_cause("talk.py", LOOP)
    assert found is not None
    assert (found.kind, found.line) == ("rate-without-spin", 5)


@pytest.mark.parametrize(
    "text",
    [
        f"threading.Thread(target=rclpy.spin, args=(node,)).start()\n{LOOP}",
        f"from rclpy import spin\n{LOOP}",
        LOOP.replace("rate.sleep()", "time.sleep(0.01)"),
        "for _ in range(9):\n    rate.sleep()\n",
    ],
)
def test_a_rate_beside_a_spin_is_no_cause(text: str) -> None:
    """A spin anywhere, or another way to wait, is left alone."""
    assert silent_cause("talk.py", text) is None


def test_an_overwritten_attribute_is_the_cause_of_an_undeclared_parameter() -> None:
    """The declaration is there: advice to declare the parameter would be wrong."""
    found = Diagnosis("parameter-not-declared", "The parameter is used.", "Declare it.", "a.py", 9)
    text = "class A(Node):\n    def __init__(self):\n        self._parameters = {}\n"
    cause = corrected(found, {"a.py": text})
    assert (cause.kind, cause.line) == ("overwritten-attribute", 3)
    assert corrected(found, {"a.py": text.replace("_parameters", "_mine")}) is found


def test_arguments_that_argparse_refuses_are_explained_at_its_call() -> None:
    """The program's own line of usage names no line of the source."""
    end = "mode.py: error: unrecognized arguments: --ros-args -r __node:=mode --params-file /p.yaml"
    output = [OutputLine(1, "stderr", "usage: mode.py [-h]"), OutputLine(2, "stderr", end)]
    found = explain(output, ["lab/mode.py"])
    assert found is not None
    text = "parser = ArgumentParser()\nfor _ in range(2):\n    given = parser.parse_args()\n"
    cause = corrected(found, {"lab/mode.py": text})
    assert (cause.kind, cause.file, cause.line) == ("ros-arguments", "lab/mode.py", 3)
    assert "parse_known_args" in cause.remedy
    own = [OutputLine(1, "stderr", "mode.py: error: unrecognized arguments: --rate")]
    assert explain(own, ["lab/mode.py"]) is None


ENDS = """
class Mode(Node):
    def __init__(self):
        self.create_service(SetBool, '/enable', self.on_request)

    def other(self):
        pass

    def on_request(self, request, response):
        response.success = True
        {last}
"""
SPINS = Diagnosis("no-response", "It returns no response.", "Return it.", "it.py", 40)


@pytest.mark.parametrize(
    "last",
    [
        "response.message = 'on'",
        "return",
        "if request.data:\n            return response",
        "try:\n            return response\n        except ValueError:\n            pass",
    ],
)
@pytest.mark.parametrize("path", ["it.py", "parts/node.py"])
def test_a_callback_without_return_is_marked_at_its_end(last: str, path: str) -> None:
    """The traceback shows the line of spin; the callback can stand in another file."""
    text = ENDS.format(last=last)
    found = corrected(SPINS, {path: text, "it.py": text if path == "it.py" else "spin()"})
    assert (found.file, found.line, found.subject) == (path, text.count("\n"), "on_request")
    assert found.problem == "on_request() ends here without `return response`."


@pytest.mark.parametrize(
    "last",
    [
        "return response",
        "raise ValueError",
        "if request.data:\n            return response\n        else:\n            return None or response",
        "with self.lock:\n            return response",
    ],
)
def test_a_callback_that_returns_is_not_marked(last: str) -> None:
    """Another program of the same kind may be the cause."""
    assert corrected(SPINS, {"it.py": ENDS.format(last=last)}) is SPINS


@pytest.mark.parametrize(
    ("handler", "line"),
    [
        ("except: pass", 4),
        ("except Exception as error: return", 4),
        ("except BaseException: ...", 4),
        ("except ValueError: pass", None),
        ("except Exception as error: print(error)", None),
        ("finally: pass", None),
    ],
)
def test_a_handler_that_hides_each_exception_is_found(handler: str, line: int | None) -> None:
    """A handler with a narrower exception, or with a word about it, hides nothing."""
    text = f"def on_state(msg):\n    try:\n        use(msg)\n    {handler}\n"
    assert hidden_exception(text) == line


def test_a_log_below_the_usual_level_is_found() -> None:
    """Only debug() of a node's logger is quiet."""
    text = "self.get_logger().info('a')\nself.get_logger().debug('b')\nother.debug('c')\n"
    assert debug_log(text) == 2
    assert debug_log("other.debug('c')") is None


@pytest.mark.parametrize(
    ("condition", "line"),
    [
        ("if on and not self.get_parameter('safe'): pass", 1),
        ("if self.get_parameter('safe'): pass", 1),
        ("x = 1 if node.get_parameter('safe') else 0", 1),
        ("if self.get_parameter('safe').value: pass", None),
        ("if self.get_parameter('safe') == other: pass", None),
    ],
)
def test_a_condition_on_a_parameters_object_is_found(condition: str, line: int | None) -> None:
    """The object is always true, its value is not."""
    assert always_true_parameter(condition) == line


@pytest.mark.parametrize(
    ("argument", "found"),
    [
        ("lambda m: self.on(name, m)", (2, "name")),
        ("lambda m, name=name: self.on(name, m)", None),
        ("lambda name: self.on(name)", None),
        ("partial(self.on, name)", None),
        ("callback=lambda m: self.on(topic, m)", None),
    ],
)
def test_a_lambda_that_sees_the_last_value_of_a_loop_is_found(
    argument: str, found: tuple[int, str] | None
) -> None:
    """A default keeps the value of each turn."""
    text = f"for name in names:\n    self.create_subscription(T, name, {argument}, 10)\n"
    assert late_lambda(text) == found


@pytest.mark.parametrize(
    ("statements", "is_found"),
    [
        ("np.subtract(a, b, out=self.error); self.errors.append(self.error)", True),
        ("self.error -= self.state; self.errors.append(self.error)", True),
        ("self.error = a - b; self.errors.append(self.error)", False),
        ("self.errors.append(self.error.copy())", False),
        ("self.errors.append(error)", False),
        ("self.errors.append(", False),
    ],
)
def test_an_attribute_that_is_appended_again_and_again_is_found(
    statements: str, is_found: bool
) -> None:
    """All entries are one object if no assignment makes the attribute anew."""
    text = f"class Node:\n    def __init__(self):\n        self.error = zeros(7)\n\n    def f(self):\n        {statements}\n"
    if is_found:
        found = (6, "self.errors.append(self.error.copy())")
    else:
        found = None
    assert appended_again(text) == found


@pytest.mark.parametrize(
    ("formatted", "line"), [("{rms:.4f}", 1), ("{np.mean(x):.4f}", 2), ("{rms}", 2), ("{y:.4f}", 2)]
)
def test_the_line_of_a_formatted_array_is_named(formatted: str, line: int) -> None:
    """The traceback names the line with the format, and the name is assigned elsewhere."""
    text = f"rms = np.sqrt(np.mean([e], axis=0))\nprint(f'RMS: {formatted}')\n"
    found = Diagnosis("format-of-several", "Several.", "Format each.", "it.py", 2)
    named = corrected(found, {"it.py": text})
    assert named.line == line
    assert named.problem.startswith("rms of line 1 holds several numbers") == (line == 1)
