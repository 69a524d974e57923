"""An evaluation reads a parameter's text as the real `rcl` does."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

pytestmark = pytest.mark.live

TEXTS = (
    *(
        "1",
        "01",
        "010",
        "08",
        "-010",
        "0x1F",
        "0X1f",
        "+5",
        "-0x10",
        "0o17",
        "0b11",
        "00",
        "-0",
        "1_000",
        "1:30",
        "5f",
    ),
    *(
        "99999999999999999999",
        "1e2",
        "1e-7",
        "1.",
        ".5",
        "-.5",
        "1.5e+3",
        "1e",
        ".e1",
        "1,5",
        "0x1.8p3",
        "0x1p3",
        "1e400",
    ),
    *(
        "inf",
        "Infinity",
        "-inf",
        ".inf",
        "-.Inf",
        "+.inf",
        "infinit",
        "y",
        "Y",
        "n",
        "N",
        "yes",
        "no",
        "on",
        "Off",
        "OFF",
    ),
    *(
        "true",
        "TRUE",
        "tRue",
        "false",
        "null",
        "~",
        "2024-01-01",
        "abc",
        "'y'",
        '"1"',
        "!!str 5",
        "[1, 2]",
        "[1.0, 2e3]",
    ),
    *("[y, n]", "[a, 'y']", "0x", "1d", "12e3"),
)

BOTH = """
import json, sys
from array import array
import rclpy
from rclpy.node import Node
from launch_plan.inside.parameter_text import read
texts = json.loads(sys.argv[1])
rclpy.init(args=[])
rules = [word for n, text in enumerate(texts) for word in ("-p", f"p{n}:={text}")]
node = Node("reader", cli_args=["--ros-args", *rules], automatically_declare_parameters_from_overrides=True,
            start_parameter_services=False, enable_rosout=False)
for n, text in enumerate(texts):
    value = node.get_parameter(f"p{n}").value
    print(json.dumps([text, repr(value.tolist() if isinstance(value, array) else value), repr(read(text))]))
"""


def test_texts_are_read_as_rcl_reads_them() -> None:
    """Each text has the same value and type in a real node as in the evaluation."""
    done = subprocess.run(
        [sys.executable, "-c", BOTH, json.dumps(TEXTS)],
        capture_output=True,
        text=True,
        env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
        timeout=60,
        check=False,
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(TEXTS), done.stderr
    assert [(text, ours) for text, real, ours in found if real != ours] == []
