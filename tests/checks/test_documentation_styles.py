"""Students' ways to document Lab 09-01, and the points that a fair teacher would give for each."""

from __future__ import annotations

from functools import cache

import pytest

from grader.judging.rubrics import read_rubric
from grader.lab.rubric import Rubric
from tests.synthetic import judged, submission

FILES = {
    "publisher": "joint_publisher.py",
    "subscriber": "joint_subscriber.py",
    "service": "robot_service.py",
    "launch": "robot_launch.py",
    "qos": "qos_comparison.py",
}
LIST = "\n".join(FILES.values())


@cache
def rubric() -> Rubric:
    """Read the lab's rubric."""
    return read_rubric(None)


def points(check: str, files: dict[str, str]) -> float:
    """Give the points of a check of the lab's rubric for a submission of these files."""
    spec = next(spec for spec in rubric().checks() if spec.id == check)
    record = submission({**dict.fromkeys(FILES.values(), "x = 1\n"), **files}, **FILES)
    finding = judged(spec.check, spec.parameters.model_dump(), None, record)
    return float(finding.credit) * float(spec.points)


@pytest.mark.parametrize(
    "text",
    [
        f"# Lab\n\n```\nlab/\n{LIST}\n```\n\n    $ ros2 launch physical_ai_textbook robot_launch.py\n",
        "# Lab\n\n| File | Run with | Does |\n|---|---|---|\n"
        + "".join(f"| {file} | `python3 {file}` | its part |\n" for file in FILES.values()),
        "Lab 09\n======\n\nUsage\n-----\n\n.. code-block:: bash\n\n   ros2 run physical_ai_textbook joint_publisher\n\n"
        "Nodes\n-----\n\n* joint_subscriber\n* robot_service\n* robot_launch\n* qos_comparison\n",
        "The publisher sends commands, the subscriber compares them with states, the service enables the arm, "
        "the launch file brings all up, and the QoS comparison prints latencies. "
        "Run them with colcon build and ros2 launch lab x.",
        "# Labor 9\n\n## Ausführen\n`python3 joint_publisher.py`, ebenso die anderen.\n\n## Aufbau\nDer Sender schickt "
        "Befehle, der Empfänger vergleicht sie, der Dienst schaltet frei, die Startdatei startet alles, und der "
        "QoS-Vergleich misst.\n",
        "# Práctica 9\n\nPara ejecutar todo: `ros2 launch physical_ai_textbook robot_launch.py`.\n\n- El publicador "
        "envía órdenes.\n- El suscriptor compara.\n- El servicio habilita.\n- La comparación de QoS mide.\n",
        "# 实验九\n\n运行:\n\n```\npython3 joint_publisher.py\n```\n\n"
        "发布者发送命令。订阅者计算误差。服务启用机器人。启动文件启动所有节点。QoS比较测量延迟。\n",
        "Лабораторная 9\n\nЗапуск: ros2 launch physical_ai_textbook robot_launch.py\n\nИздатель шлёт команды, "
        "подписчик считает ошибку, сервис включает робота, сравнение QoS меряет задержки.\n",
        "# Lab\n\n## How to start\nOpen each file in the editor and press its run button.\n\n## Files\n"
        + "".join(f"1. **{file}**\n" for file in FILES.values()),
        "# TP 9\n\n"
        + "".join(f"## {file}\nLancer avec `python3 {file}`.\n\n" for file in FILES.values()),
    ],
    ids=[
        "tree",
        "table",
        "rst",
        "sentences",
        "german",
        "spanish",
        "chinese",
        "russian",
        "editor",
        "french",
    ],
)
def test_a_readme_that_helps_a_reader_gets_all(text: str) -> None:
    """The README tells how to run the work and describes each part, in any form and language."""
    assert points("documentation.readme", {"README.md": text}) == 4


HEADINGS = "# Lab\n\n## How to run\n\n{0}\n\n" + "".join(
    f"## {file}\n\n{{0}}\n\n" for file in FILES.values()
)


@pytest.mark.parametrize(
    ("text", "most"),
    [
        (HEADINGS.format(""), 0),
        (HEADINGS.format("TODO: describe this part"), 0),
        (HEADINGS.format("<your text here>"), 0),
        (HEADINGS.format("Lorem ipsum dolor sit amet, consectetur adipiscing elit."), 0),
        (
            '#!/usr/bin/env python3\n"""Joint publisher."""\nimport rclpy\n\n\nclass JointPublisher:\n    pass\n',
            0,
        ),
        (HEADINGS.format("```python\nimport rclpy\n\nrclpy.init()\n```"), 0),
        ("# Lab 09-01\n\nI enjoyed this lab very much and learned a lot about robots.\n", 0),
        ("# Lab 09-01: publisher, subscriber, service\n\nRobotics, by Ann.\n", 0),
        ("# Lab\n\nRun `ros2 launch physical_ai_textbook robot_launch.py`.\n", 2.4),
        ("# Lab\n\nRun `ros2 launch arm robot_launch.py` or `ros2 run arm qos_comparison`.\n", 4),
        ("# Lab\n\nThe files:\n\n" + "".join(f"- {file}\n" for file in FILES.values()), 2),
    ],
    ids=[
        "empty",
        "todo",
        "template",
        "lorem",
        "code",
        "pasted",
        "chat",
        "title",
        "run only",
        "run both",
        "list only",
    ],
)
def test_a_hollow_readme_gets_what_it_says(text: str, most: float) -> None:
    """Templates, filler and pasted code earn nothing; half of the required content earns half."""
    assert points("documentation.readme", {"README.md": text}) == most


CODE = """{head}import rclpy
from rclpy.node import Node


class Talker(Node):
{of_class}    def __init__(self):
        super().__init__("talker")
{inside}        self.publisher = self.create_publisher(Float64MultiArray, "/joint_commands", 10)

{above}    def tick(self):
{docstring}        self.time += 0.01
{reason}        message = Float64MultiArray()
        message.data = [0.0] * 7
        message.data[0] = math.sin(self.time)
        self.publisher.publish(message)


def main():
    rclpy.init()
{in_main}    rclpy.spin(Talker())
"""
SLOTS = dict.fromkeys(("head", "of_class", "inside", "above", "docstring", "reason", "in_main"), "")


def code_points(slots: dict[str, str]) -> float:
    """Give the points for five files with these texts in their slots; `@` is the name of the file."""
    filled = {**SLOTS, **slots}
    return points(
        "documentation.code",
        {f: CODE.format(**filled).replace("@", f.split(".")[0]) for f in FILES.values()},
    )


@pytest.mark.parametrize(
    "slots",
    [
        {
            "head": '"""Sends the commands of @."""\n',
            "docstring": '        """Publish the next row in @."""\n',
        },
        {
            "of_class": '    """Sends @ commands."""\n\n',
            "docstring": '        """Publish the next row in @."""\n',
        },
        {
            "inside": "        # a queue of ten is enough for @\n",
            "reason": "        # @ keeps the others at rest\n",
        },
        {
            "head": "# Node that sends sine waves, part @\n",
            "above": "    # Called a hundred times a second by @\n",
        },
        {
            "head": "# Schickt Sinuswellen, Teil @\n",
            "reason": "        # alle anderen Gelenke von @ ruhen\n",
        },
        {
            "head": '"""Envía las órdenes de @."""\n',
            "docstring": '        """Publica la fila siguiente de @."""\n',
        },
        {"head": "# @：发送关节命令\n", "reason": "        # @ 的其余关节保持静止\n"},
        {
            "of_class": "    '''@はアームへ指令を送る。'''\n\n",
            "reason": "        # @の他の関節は動かさない\n",
        },
        {
            "head": "'''\nOutput of @: joint angles.\n'''\n",
            "docstring": "        '''\n        Next row of @.\n        '''\n",
        },
        {
            "inside": "        self.time = 0.0  # @ counts seconds from start\n",
            "above": "    # @ timer: next sample\n",
        },
    ],
    ids=[
        "docstrings",
        "class",
        "comments",
        "above",
        "german",
        "spanish",
        "chinese",
        "japanese",
        "quotes",
        "inline",
    ],
)
def test_code_that_is_explained_in_any_way_gets_all(slots: dict[str, str]) -> None:
    """Docstrings alone and comments alone are as good as each other, in any language."""
    assert code_points(slots) == 6


LICENCE = "# Copyright 2024 Somebody of @\n#\n# Licensed under the Apache License, Version 2.0\n\n"
OFF = "        # message.data = [1.0] * 7\n        # self.publisher.publish(message)\n"


@pytest.mark.parametrize(
    ("slots", "most"),
    [
        ({}, 0),
        ({"head": LICENCE}, 0),
        (
            {
                "reason": OFF,
                "inside": "        # self.timer = self.create_timer(0.01, self.tick)\n",
            },
            0,
        ),
        ({"inside": "        # create publisher\n", "reason": "        # message\n"}, 0),
        ({"head": '"""TODO: add docstring for @."""\n', "docstring": '        """TODO."""\n'}, 0),
        (
            {
                "head": '"""@"""\n',
                "of_class": '    """Talker class."""\n\n',
                "docstring": '        """Tick function."""\n',
            },
            0,
        ),
        ({"head": "# Import libraries for @\n", "in_main": "    # initialise ROS for @\n"}, 0),
        (
            {
                "head": '"""Lorem ipsum dolor sit amet, @."""\n',
                "docstring": '        """Lorem ipsum, dolor sit amet."""\n',
            },
            0,
        ),
        ({"head": "# this is important\n", "reason": "        # this is important\n"}, 0),
        (
            {
                "head": "#!/usr/bin/env python3\n# -*- coding: utf-8 -*-\n",
                "reason": "        # ----------\n",
            },
            0,
        ),
        ({"head": '"""Sends the commands of @."""\n'}, 6),
    ],
    ids=[
        "nothing",
        "licence",
        "off",
        "echo",
        "todo",
        "names",
        "imports",
        "lorem",
        "same",
        "tools",
        "heads",
    ],
)
def test_code_that_only_looks_explained_gets_what_it_says(
    slots: dict[str, str], most: float
) -> None:
    """Licences, switched off code, echoes and templates explain nothing; heads alone explain the files."""
    assert code_points(slots) == pytest.approx(most, abs=0.01)
