"""Launch files of any text: each is evaluated in bounded time, and gives a plan or says what is wrong with it."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grader.recording.launch_plan import Plan
from tests.live.launch.evaluations import environment, make_package, plans_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")

IMPORTS = "from launch import *\nfrom launch.actions import *\nfrom launch.substitutions import *\n"
IMPORTS += "from launch_ros.actions import *\n"
#: By the language of a launch file: how it begins and ends, and what may stand between.
LANGUAGES = {
    ".py": (
        f"{IMPORTS}def generate_launch_description():\n return LaunchDescription([\n",
        "])\n",
        (
            *("Node(package='demo', executable='talker'),\n", "Node(", "package=", "'demo', ", "parameters=[{'a': ", "}]"),
            *("DeclareLaunchArgument('a', default_value=", "LaunchConfiguration('a')", "GroupAction([", "]),\n", "*[", "("),
            *("PythonExpression(['", "'])", "PathJoinSubstitution([", "TimerAction(period=", "1e400", "10**9", "None, "),
            *("IncludeLaunchDescription(", "__file__", "Command(['echo ", "ExecuteProcess(cmd=[", "lambda c: ", "\\", "'''"),
            *("OpaqueFunction(function=", "remappings=[('a', ", "name='", "\n", "#", ")", "{", "f'{", "'", ", "),
        ),
    ),
    ".xml": (
        "<launch>",
        "</launch>",
        (
            *('<node pkg="demo" exec="talker"/>', '<node pkg="demo" exec="talker">', "</node>", '<arg name="a" default="'),
            *('"/>', "$(var a)", "$(eval '", "$(env HOME ", "$(find-pkg-share demo)", "$(dirname)", "$(", ")", "'", "\\"),
            *("<group>", "</group>", '<include file="', '<param name="p" value="', '<param from="', "<![CDATA[", "<!--"),
            *('<!DOCTYPE x [<!ENTITY a "b">]>', "&a;", "&#0;", "&", "<", ">", '<executable cmd="', '<let name="a" value="'),
            *('<timer period="', 'if="', "1e400", "\x00", "<?xml?>", "é", 'xmlns:a="b"', "<a:b/>", "<reset/>", "\n"),
        ),
    ),
    ".yaml": (
        "launch:\n",
        "",
        (
            *("- node:\n", "    pkg: demo\n", "    exec: talker\n", "    param:\n", "    - name: p\n", "      value: ", "1e400\n"),
            *("- arg:\n", "    name: a\n", "    default: ", "$(var a)\n", '"$(eval \'', "- group:\n", "- include:\n", "    file: "),
            *("&a ", "*a", "<<: *a\n", "{", "[", "- ", ": ", "!!python/object:os.system ", "? ", "| \n", "---\n", "\t", "#"),
            *("0x" + "f" * 30 + "\n", "2001-01-01\n", "~\n", ".inf\n", "- let: {name: a, value: ", "}\n", '"', "'", "\n", "é"),
        ),
    ),
}


@st.composite
def launch_files(draw: st.DrawFn) -> tuple[str, str]:
    """Draw the suffix and the text of a launch file."""
    suffix = draw(st.sampled_from(sorted(LANGUAGES)))
    begins, ends, pieces = LANGUAGES[suffix]
    inner = st.one_of(
        st.lists(st.sampled_from(pieces), max_size=25).map("".join),
        st.tuples(st.sampled_from(pieces), st.integers(2, 3000)).map(lambda pair: pair[0] * pair[1]),
        st.text(max_size=200),
    )
    return suffix, draw(st.one_of(inner, inner.map(lambda text: f"{begins}{text}{ends}")))


@settings(max_examples=2, deadline=None)
@given(st.lists(launch_files(), min_size=30, max_size=30))
def test_any_text_is_a_launch_file_or_is_said_to_be_none(texts: list[tuple[str, str]]) -> None:
    """Neither ends the evaluation, nor takes ten seconds of it; what comes of it is a plan."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prefix = make_package(folder / "prefix", "demo", "talker")
        requests = []
        for number, (suffix, text) in enumerate(texts):
            path = folder / "src" / str(number) / f"robot.launch{suffix}"
            path.parent.mkdir(parents=True)
            path.write_text(text, encoding="utf-8", errors="surrogatepass")
            requests.append({"file": str(path), "arguments": {}, "root": str(path.parent)})
        for given_text, plain in zip(texts, plans_of(requests, environment(prefix)), strict=True):
            plan = Plan.from_plain(plain) if plain else None
            assert plan is not None, given_text
            assert plan.outcome == "ok" or plan.problem is not None
            assert plan.problem is None or plan.problem.kind not in ("exception", "internal"), (given_text, plan.problem)
