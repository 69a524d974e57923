"""Libraries that are loaded before forks."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

pytestmark = pytest.mark.live

LOADS = """
import json, os
import rclpy
from grader.live.ros_node import libraries

rclpy.get_rmw_implementation_identifier()
threads = len(os.listdir("/proc/self/task"))
libraries.load_type_support(["std_srvs/srv/SetBool", "nowhere/msg/Thing"])
print(json.dumps([open("/proc/self/maps").read(), len(os.listdir("/proc/self/task")) - threads]))
"""


def test_type_support_is_loaded_and_no_thread_started() -> None:
    """A process can fork after it; packages without type support are passed over."""
    run = subprocess.run([sys.executable, "-c", LOADS], capture_output=True, text=True, check=True)
    maps, more_threads = json.loads(run.stdout)
    for kind in ("fastrtps_c", "introspection_c"):
        assert f"/libstd_srvs__rosidl_typesupport_{kind}.so" in maps
    assert more_threads == 0
