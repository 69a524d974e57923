"""The decision if a file starts its node by itself, made without running the file."""

from __future__ import annotations

import pytest

from grader.live.session.entry import function_to_call
from tests.counted import calls_of

MAIN = "import rclpy\ndef main():\n    rclpy.init()\n    rclpy.spin(Node())\n"


@pytest.mark.parametrize(
    "more",
    [
        "",
        "import numpy as np\nnp.set_printoptions(precision=4)\n",
        "LOG = logging.getLogger('x')\nLOG.setLevel(10)\n",
        "class Wave:\n    pass\nWAVES = [Wave(), Wave()]\n",
        "def table():\n    return [1]\nTABLE = table()\n",
        "try:\n    import fast\nexcept ImportError:\n    fast = None\n",
        "colorama.init()\n",
        "if TYPE_CHECKING:\n    import x\n",
        "for name in names:\n    register(lambda: rclpy.spin(name))\n",
    ],
)
def test_a_file_for_an_entry_point_is_recognised(more: str) -> None:
    """Settings, constants and imports at module level start no node."""
    assert function_to_call(more + MAIN) == "main"
    assert function_to_call(MAIN + more) == "main"


@pytest.mark.parametrize(
    "more",
    [
        "main()\n",
        "if __name__ == '__main__':\n    main()\n",
        "if '__main__' == __name__: sys.exit(main())\n",
        "asyncio.run(main())\n",
        "try:\n    main()\nexcept KeyboardInterrupt:\n    pass\n",
        "rclpy.init()\nrclpy.spin(Node())\n",
        "with rclpy.init():\n    spin(Node())\n",
        "def start():\n    main()\nstart()\n",
        "class App:\n    def __init__(self):\n        rclpy.init()\nApp()\n",
        "executor = MultiThreadedExecutor()\nexecutor.add_node(node)\n",
    ],
)
def test_a_file_that_runs_by_itself_is_left_alone(more: str) -> None:
    """Whatever leads to a node at module level is the file's own way to start."""
    assert function_to_call(MAIN + more) is None


def test_entry_points_say_which_function_is_meant() -> None:
    """One that the file has not, or that does not help, is passed over."""
    text = MAIN.replace("main", "run") + "def other():\n    pass\n"
    assert function_to_call(text) is None
    assert function_to_call(text, ["run"]) == "run"
    assert function_to_call(text, ["gone", "other"]) == "other"
    assert function_to_call(MAIN, ["gone"]) == "main"


@pytest.mark.parametrize(
    "text", ["x = 1\n", "def main(:\n", "\0", MAIN + "x = " + "-" * 5000 + "1\n"]
)
def test_text_without_such_a_function_is_run_as_it_is(text: str) -> None:
    """Text without such a function, or that is no Python at all, is run as it is."""
    assert function_to_call(text) is None


def test_functions_that_call_each_other_are_followed_once() -> None:
    """Each of thousands of functions in a chain of calls is looked at once."""
    chain = "".join(f"def f{n}():\n    f{n - 1}()\n" for n in range(1, 2000))
    text = "def main():\n    pass\ndef f0():\n    main()\n" + chain
    assert function_to_call(text + "f1999()\n") is None
    assert calls_of(lambda: function_to_call(text)) < 400_000
