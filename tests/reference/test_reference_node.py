"""The configuration of reference nodes."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from arm import ArmSettings
from plateau_schedule import PlateauSettings

from grader.recording.trusted_channel import digest
from grader.reference_node import (
    BAD_CONFIGURATION_STATUS,
    MOST_WAITING_BYTES,
    ConfigurationError,
    build_settings,
    parse_configuration,
    reference_node,
)
from tests.reference.live_graph import use_private_graph


def test_configuration_is_read_and_names_are_mapped() -> None:
    """A topic that the student named otherwise is found under that name, all others under their own."""
    configuration = parse_configuration(
        '{"seed": 4, "names": {"/a": "/b"}, "with": {"rate_hz": 50}}'
    )
    assert (configuration.seed, configuration.name("/a"), configuration.name("/c")) == (
        4,
        "/b",
        "/c",
    )
    assert build_settings(ArmSettings, configuration.settings).rate_hz == 50


@pytest.mark.parametrize("text", ["", "[]", '{"sed": 1}', '{"seed": "1"}', '{"names": ["/a"]}'])
def test_a_configuration_that_is_none_is_refused(text: str) -> None:
    """Any text but the documented JSON object is refused with a sentence."""
    with pytest.raises(ConfigurationError):
        parse_configuration(text)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (ArmSettings, {"rate": 100}),
        (ArmSettings, {"rate_hz": 0}),
        (ArmSettings, {"rate_hz": "fast"}),
        (ArmSettings, {"simulation_time": True, "rate_hz": 100, "clock_rate_hz": 250}),
        (ArmSettings, {"noise_rad": -1}),
        (PlateauSettings, {"plateaus": 2}),
        (PlateauSettings, {"silence_s": 0}),
        (PlateauSettings, {"history": 100}),
    ],
)
def test_settings_that_cannot_work_are_refused(kind: type, settings: dict[str, object]) -> None:
    """An unknown key or an impossible value in the rubric's `with` is refused before anything starts."""
    with pytest.raises(ConfigurationError):
        build_settings(kind, settings)


def test_a_configuration_can_come_where_no_command_line_shows_it() -> None:
    """With a dash in its place it is read from standard input, and refused like any other."""
    program = Path(__file__).resolve().parents[2] / "reference" / "plateaus.py"
    run = subprocess.run(
        [sys.executable, "-I", str(program), "-"],
        input='{"with": {"plateaux": 6}}',
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == BAD_CONFIGURATION_STATUS
    assert "unknown setting 'plateaux'" in run.stderr


#: Sleeps for a minute, through a signal that asks for no stop.
SLEEPER = """
import os, signal, time
from grader.reference_node import StopRequest, sleep_until
stop = StopRequest()
signal.signal(signal.SIGUSR1, lambda number, frame: os.write(1, b"other\\n"))
began_s = time.process_time()
print("sleeps", flush=True)
sleep_until(time.monotonic_ns() + 60 * 10**9, stop)
print("stopped" if stop else "through", time.process_time() - began_s < 0.2, flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_ends_a_long_sleep(number: int) -> None:
    """A node sleeps without looking for a stop, which ends its sleep, and no other signal does."""
    with subprocess.Popen(
        [sys.executable, "-I", "-c", SLEEPER], stdout=subprocess.PIPE, text=True
    ) as sleeper:
        assert sleeper.stdout is not None
        assert sleeper.stdout.readline() == "sleeps\n"
        sleeper.send_signal(signal.SIGUSR1)
        assert sleeper.stdout.readline() == "other\n"
        time.sleep(0.5)
        assert sleeper.poll() is None
        sleeper.send_signal(number)
        assert sleeper.stdout.readline() == "stopped True\n"


@pytest.mark.live
def test_the_digests_of_all_messages_are_reported_in_order(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Short messages, equal ones among them, wait for their digests until there are many, and a long one does not."""
    std_msgs = pytest.importorskip("std_msgs.msg", reason="needs the ROS wheels")
    serialization = pytest.importorskip("rclpy.serialization")
    use_private_graph(monkeypatch.setenv, tmp_path)
    words = [str(number // 3) for number in range(1000)]
    words[500] = "long" * MOST_WAITING_BYTES
    with reference_node("beacon") as reference:
        publisher = reference.open_publisher(std_msgs.String, "/words", 10)
        for word in words:
            publisher.publish(std_msgs.String(data=word))
    reported = ""
    for line in capsys.readouterr().out.splitlines():
        if line.startswith("published /words std_msgs/msg/String "):
            reported += line.split()[3]
    messages = [serialization.serialize_message(std_msgs.String(data=word)) for word in words]
    assert reported == "".join(map(digest, messages))
