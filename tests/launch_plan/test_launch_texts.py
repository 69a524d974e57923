"""Launch files of any text: each gives a plan or names its mistake, in bounded time."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from launch_plan.plan import Plan
from tests.launch_plan.evaluations import environment, make_package, plans_of
from tests.thorough import examples

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the live half runs on Linux alone")

IMPORTS = "from launch import *\nfrom launch.actions import *\nfrom launch.substitutions import *\n"
IMPORTS += "from launch_ros.actions import *\n"
#: Pieces of launch files by their language, divided by a sign that none has.
PIECES = {
    ".py": "Node(package='demo', executable='talker'),\n¦Node(¦package=¦'demo', ¦parameters=[{'a': ¦}]¦]),\n¦*[¦(¦, "
    "¦DeclareLaunchArgument('a', default_value=¦LaunchConfiguration('a')¦GroupAction([¦'])¦1e400¦-1, ¦__file__¦'''¦{"
    "¦PythonExpression(['¦PathJoinSubstitution([¦TimerAction(period=¦IncludeLaunchDescription(¦None, ¦lambda c: ¦\\¦\n"
    "¦Command(['echo ¦ExecuteProcess(cmd=[¦OpaqueFunction(function=¦remappings=[('a', ¦name='¦f'{¦#¦)¦'",
    ".xml": '<node pkg="demo" exec="talker"/>¦<node pkg="demo" exec="talker">¦</node>¦<arg name="a" default="¦"/>¦)¦\\'
    "¦$(var a)¦$(eval '¦$(env HOME ¦$(find-pkg-share demo)¦$(dirname)¦$(¦<group>¦</group>¦'¦&a;¦\n¦&#0;¦&¦<¦>¦\0¦é"
    '¦<include file="¦<param name="p" value="¦<param from="¦<![CDATA[¦<!--¦<!DOCTYPE x [<!ENTITY a "b">]>¦<?xml?>¦if="'
    '¦<executable cmd="¦<let name="a" value="¦<timer period="¦xmlns:a="b"¦<a:b/>¦<reset/>¦1e400',
    ".yaml": "- node:\n¦    pkg: demo\n¦    exec: talker\n¦    param:\n¦    - name: p\n¦      value: ¦1e400\n¦*a¦{¦["
    "¦- arg:\n¦    name: a\n¦    default: ¦$(var a)\n¦\"$(eval '¦- group:\n¦- include:\n¦    file: ¦&a ¦- ¦: ¦\t¦#¦é"
    "¦<<: *a\n¦!!python/object:os.system ¦? ¦| \n¦---\n¦0xfffffffffffffffff\n¦2001-01-01\n¦~\n¦.inf\n¦}\n¦'¦\n"
    '¦- let: {name: a, value: ¦"',
}
#: Beginning and end of a launch file.
AROUND = {
    ".py": (f"{IMPORTS}def generate_launch_description():\n return LaunchDescription([\n", "])\n"),
    ".xml": ("<launch>", "</launch>"),
    ".yaml": ("launch:\n", ""),
}


@st.composite
def launch_files(draw: st.DrawFn) -> tuple[str, str]:
    """Draw the suffix and the text of a launch file."""
    suffix = draw(st.sampled_from(sorted(PIECES)))
    pieces, (begins, ends) = PIECES[suffix].split("¦"), AROUND[suffix]
    inner = st.one_of(
        st.lists(st.sampled_from(pieces), max_size=25).map("".join),
        st.tuples(st.sampled_from(pieces), st.integers(2, 3000)).map(
            lambda pair: pair[0] * pair[1]
        ),
        st.text(max_size=200),
    )
    return suffix, draw(st.one_of(inner, inner.map(lambda text: f"{begins}{text}{ends}")))


@settings(max_examples=2, deadline=None)
@given(st.lists(launch_files(), min_size=examples(100), max_size=examples(100)))
def test_any_text_is_a_launch_file_or_is_said_to_be_none(texts: list[tuple[str, str]]) -> None:
    """No text ends the evaluation or takes ten seconds of it. Every result is a plan."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prefix = make_package(folder / "prefix", "demo", "talker")
        requests = []
        for number, (suffix, text) in enumerate(texts):
            path = folder / "src" / str(number) / f"robot.launch{suffix}"
            path.parent.mkdir(parents=True)
            path.write_text(text, encoding="utf-8", errors="surrogatepass")
            requests.append({"file": str(path), "arguments": {}, "root": str(path.parent)})
        for written, plain in zip(texts, plans_of(requests, environment(prefix)), strict=True):
            assert plain, written
            plan = Plan.from_plain(plain)
            assert (plan.problem is None) == (plan.outcome == "ok"), written
