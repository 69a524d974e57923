"""`grade play` on a real ROS graph: every message of a recording again, in order, at its pace, with the clock."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from grader.recording.session import read_session
from grader.result_folder import RECORDINGS
from ros_bag.reading import Bag

pytestmark = pytest.mark.live

KEPT = Path(__file__).resolve().parents[1] / "recordings" / "solution"

# Subscribes, plays, and reports the time and the content of each message.
LISTENER = """
import json, os, subprocess, sys, threading, time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
rclpy.init()
node = rclpy.create_node("listener")
heard = {"/joint_commands": [], "/joint_states": [], "/clock": []}
for topic, taken in heard.items():
    kind = Clock if topic == "/clock" else Float64MultiArray
    def take(data, info, taken=taken):
        taken.append((info["source_timestamp"], bytes(data).hex()))
    node.create_subscription(kind, topic, take, QoSProfile(depth=5000), raw=True)
executor = SingleThreadedExecutor()
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
command = [sys.executable, "-m", "grader.cli", "play", *sys.argv[2:]]
environment = {**os.environ, **json.loads(sys.argv[1])}
folder = environment.pop("PLAY_IN", None)
player = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment)
time.sleep(1.0)
print(json.dumps({"status": player.returncode, "said": player.stdout + player.stderr, "heard": heard}), flush=True)
"""


def played(
    tmp_path: Path, domain_id: int, *options: str, settings: dict[str, str] | None = None
) -> dict[str, Any]:
    """Play a session of the solution in a network of its own, if that is permitted, to a node that listens.

    The settings are of the player's environment alone.
    """
    results = tmp_path / "alice"
    shutil.copytree(KEPT, results / RECORDINGS, dirs_exist_ok=True)
    own = ["unshare", "--net", "--map-root-user"]
    may = subprocess.run([*own, "true"], capture_output=True).returncode == 0
    told = json.dumps(settings or {})
    command = [sys.executable, "-c", LISTENER, told, str(results), *options]
    if may:
        command = [*own, "sh", "-c", 'ip link set lo up; exec "$@"', "sh", *command]
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain_id),
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert answer["status"] == 0, answer["said"]
    return answer


def bytes_of(heard: list[tuple[int, str]]) -> list[bytes]:
    """Return the messages that were heard."""
    return [bytes.fromhex(data) for _, data in heard]


def test_all_is_published_again_at_its_pace(tmp_path: Path) -> None:
    """Bytes and order are the recorded ones, the recorded clock among them, and so is the time between messages."""
    answer = played(tmp_path, 61, "launch")
    bag = Bag.open(KEPT / "launch")
    for topic, heard in answer["heard"].items():
        stream = bag.stream(topic)
        assert bytes_of(heard) == list(stream.data), topic
        took_s = (heard[-1][0] - heard[0][0]) / 1e9
        # A busy machine makes some late, perhaps the first.
        assert took_s > 0.8 * float(np.ptp(stream.received_ns)) / 1e9, topic
    assert "/joint_commands: 302 messages, std_msgs/msg/Float64MultiArray" in answer["said"]


def test_a_part_is_played_faster_with_a_clock_of_its_own(tmp_path: Path) -> None:
    """A part is played faster, without earlier messages, on a clock that goes on evenly.

    If no clock was recorded, the clock shows the recording's time.
    """
    answer = played(
        tmp_path, 62, "publisher", "--from", "3", "--rate", "2", "--topics", "/joint_commands"
    )
    start_ns = read_session(KEPT / "publisher").started_ns + 3 * 10**9
    stream = Bag.open(KEPT / "publisher").stream("/joint_commands")
    later = []
    for data, t_ns in zip(stream.data, stream.received_ns, strict=True):
        if t_ns >= start_ns:
            later.append(data)
    heard = bytes_of(answer["heard"]["/joint_commands"])
    # Messages before a subscription is known reach it as little as at the time of the recording.
    assert len(later) // 2 < len(heard) <= len(later)
    assert heard == later[-len(heard) :]
    clock = answer["heard"]["/clock"]
    told_ns = []
    for d in bytes_of(clock):
        told_ns.append(int.from_bytes(d[4:8], "little") * 10**9 + int.from_bytes(d[8:12], "little"))
    assert len(told_ns) > 20
    assert start_ns <= told_ns[0] < told_ns[-1] < start_ns + 5 * 10**9
    slope = np.polyfit(
        [(t_ns - clock[0][0]) / 1e9 for t_ns, _ in clock], (np.array(told_ns) - start_ns) / 1e9, 1
    )[0]
    assert slope == pytest.approx(2, rel=0.05)


# Takes all transports away: a program with this setting reaches nobody.
MUTE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
<transport_descriptors><transport_descriptor><transport_id>none</transport_id><type>UDPv4</type>
<interfaceWhiteList><address>192.0.2.1</address></interfaceWhiteList></transport_descriptor></transport_descriptors>
<participant profile_name="mute" is_default_profile="true"><rtps>
<userTransports><transport_id>none</transport_id></userTransports><useBuiltinTransports>false</useBuiltinTransports>
</rtps></participant></profiles></dds>
"""
TRAP = "import pathlib; pathlib.Path(__file__).with_suffix('.sprung').touch()"


def test_it_takes_nothing_from_the_working_folder(tmp_path: Path) -> None:
    """Neither a profile of DDS nor a module that lies in a student's folder has a say, however the terminal is set."""
    folder = tmp_path / "alice"
    folder.mkdir()
    (folder / "DEFAULT_FASTRTPS_PROFILES.xml").write_text(MUTE)
    (folder / "mute.xml").write_text(MUTE)
    for name in ("rclpy", "rosgraph_msgs", "std_msgs"):
        (folder / f"{name}.py").write_text(TRAP)
    settings = {
        "PLAY_IN": str(folder),
        "PYTHONPATH": ".",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(folder / "mute.xml"),
    }
    answer = played(tmp_path, 63, "launch", "--rate", "4", settings=settings)
    assert len(answer["heard"]["/joint_commands"]) > 100
    assert list(folder.glob("*.sprung")) == []
