"""The plateau stimulus as a node on a real graph."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference"))

from plateau_schedule import COMMAND, STATE, Event, PlateauSettings, schedule

from grader.recording.trusted_channel import DIGEST_DIGITS, digest
from tests.reference.live_graph import (
    Listener,
    lines,
    listener,
    started,
    stop,
    stop_and_hear,
    use_private_graph,
)

# Short, so that the test is: the node knows nothing of the numbers.
SHORT = {"rate_hz": 500, "early_s": 0.5, "subscriptions": 1}


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """A domain for the test alone."""
    return use_private_graph(monkeypatch.setenv, tmp_path)


def values(heard: Listener, topic: str) -> list[tuple[float, ...]]:
    """Give all data received on a topic."""
    return [tuple(message.data) for _, message in heard.received[topic]]


@pytest.mark.live
def test_stimulus_plays_the_schedule_of_its_seed(domain_id: int) -> None:
    """A subscriber receives the schedule's messages in order and on time, and then no more; each was told.

    The stimulus knows that it is matched a little before the subscriber does, so the first of the early
    states may be missing; nothing else may.
    """
    from std_msgs.msg import Float64MultiArray

    names = {"/joint_commands": "/cmds"}
    settings = PlateauSettings(**SHORT)  # type: ignore[arg-type]
    events = schedule(8, settings)
    commands = [event for event in events if event.role == COMMAND]
    states = [event for event in events if event.role == STATE]
    with listener(domain_id) as heard:
        heard.listen("/cmds", Float64MultiArray)
        heard.listen("/joint_states", Float64MultiArray)
        sent: list[bytes] = []
        heard.node.create_subscription(Float64MultiArray, "/cmds", sent.append, 2000, raw=True)
        with started(
            "plateaus.py", {"seed": 8, "names": names, "with": SHORT}, domain_id
        ) as stimulus:
            last = [states[-1].values] * settings.last_states
            assert heard.spin_until(
                lambda: values(heard, "/joint_states")[-len(last) :] == last, 60
            )
            assert lines(stimulus).readline() == "done\n"
            heard.spin_for(0.2)
            told = stop_and_hear(stimulus)
            assert stimulus.returncode == 0
    floats = "std_msgs/msg/Float64MultiArray"
    assert sent
    assert told[f"/cmds {floats}"].endswith("".join(map(digest, sent)))
    assert len(told[f"/cmds {floats}"]) == len(commands) * DIGEST_DIGITS
    assert len(told[f"/joint_states {floats}"]) == len(states) * DIGEST_DIGITS
    assert values(heard, "/cmds") == [event.values for event in commands]
    require_states_on_time(heard, states)


def require_states_on_time(heard: Listener, states: list[Event]) -> None:
    """Require all states but the first early ones, in order, at the schedule's times."""
    received = heard.received["/joint_states"]
    missing = len(states) - len(received)
    assert 0 <= missing < len(states) - 1100
    assert values(heard, "/joint_states") == [event.values for event in states[missing:]]
    sent_s = np.array([t_ns for t_ns, _ in received]) / 1e9
    late_s = sent_s - np.array([state.t_s for state in states[missing:]])
    # The median, because the machine may delay some.
    assert np.median(np.abs(late_s - np.median(late_s))) < 0.02


@pytest.mark.live
def test_stimulus_goes_on_with_one_topic_matched(domain_id: int) -> None:
    """A subscriber that missed a topic still gets the other, after the time for matching is up."""
    from std_msgs.msg import Float64MultiArray

    # Slow enough that the schedule is not over before a subscriber on a busy machine is found.
    settings = {**SHORT, "rate_hz": 150, "match_timeout_s": 0.5}
    with listener(domain_id) as heard:
        heard.listen("/joint_states", Float64MultiArray)
        received = heard.received["/joint_states"]
        with started("plateaus.py", {"seed": 8, "with": settings}, domain_id) as stimulus:
            assert heard.spin_until(lambda: len(received) >= 100, 30)
            assert stop(stimulus) == (0, "", "")
