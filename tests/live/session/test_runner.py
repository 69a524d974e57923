"""Sandboxes: nothing gets in from the caller, nothing gets out to other sandboxes, and nothing is left afterwards."""

from __future__ import annotations

import itertools
import json
import os
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT))

from confine.priority import MEASURED, STANDING  # noqa: E402
from grader.files import UNFINISHED  # noqa: E402
from grader.live.sandbox.probing import probe_isolation  # noqa: E402
from grader.live.session.runner import Progress  # noqa: E402
from grader.recording.session import ProcessRun, SessionRecord, read_session  # noqa: E402
from tests.confine.test_priority import may_raise  # noqa: E402
from tests.live.small_lab import (  # noqa: E402
    FLOATS,
    TALKER,
    TEXT,
    Lab,
    Watch,
    below,
    command_of,
    interrupt_students,
    make_lab,
    mounts_below,
    name_of,
    own_temporary_folder,
    published,
    record_one,
    remains,
    texts,
    until,
)
from tests.thorough import EVERY_ATTACK, examples, part  # noqa: E402

pytestmark = pytest.mark.live

START: dict[str, Any] = {"start": {"student": "talker"}}
HEARD: dict[str, Any] = {"wait_for": {"publisher": "/chatter", "type": TEXT, "timeout_s": 20}}
OBSERVE: dict[str, Any] = {
    "observe": {"duration_s": 0.5, "first_message_on": "/chatter", "timeout_s": 20}
}
INTERRUPT: dict[str, Any] = {"interrupt": {"process": "talker"}}


@pytest.fixture(scope="module", autouse=True)
def _confined() -> None:
    """Skip where no sandboxes can be made."""
    isolation = probe_isolation(Path(sys.executable))
    if not isolation.namespaces:
        pytest.skip(f"no sandboxes here: {isolation.remedy}")


def command(lab: Lab) -> list[str]:
    """Return the command line that grades a lab."""
    arguments = [str(lab.submission), "--rubric", str(lab.rubric_file), "-o", str(lab.results)]
    return [sys.executable, "-m", "grader.cli", *arguments]


def environment(temporary: Path, **more: str) -> dict[str, str]:
    """Return this process's environment with another temporary folder."""
    return {**os.environ, "TMPDIR": str(temporary), **more}


def record_of(lab: Lab, session: str = "only") -> SessionRecord:
    """Read the record of a session that the command left."""
    return read_session(lab.results / lab.submission.name / "recordings" / session)


# -- what gets in -----------------------------------------------------------------------------


def test_callers_environment_reaches_no_process_of_a_sandbox(tmp_path: Path) -> None:
    """Whatever the caller has exported, the node runs as ever and sees none of it."""
    shadow = tmp_path / "hostile"
    (shadow / "rclpy").mkdir(parents=True)
    (shadow / "rclpy" / "__init__.py").write_text(
        "raise SystemExit('the wrong rclpy')\n", encoding="utf-8"
    )
    (shadow / "profiles.xml").write_text("this is no XML", encoding="utf-8")
    hostile = {
        "PYTHONPATH": str(shadow),
        "AMENT_PREFIX_PATH": str(shadow),
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(shadow / "profiles.xml"),
        "FASTDDS_BUILTIN_TRANSPORTS": "SHM",
        "ROS_DOMAIN_ID": "300",
        "ROS_LOCALHOST_ONLY": "1",
        "RMW_IMPLEMENTATION": "rmw_nonsense_cpp",
        "RCUTILS_LOGGING_USE_STDOUT": "nonsense",
        "RCUTILS_CONSOLE_OUTPUT_FORMAT": "hostile",
        "LD_PRELOAD": str(shadow / "nonexistent.so"),
        "PYTHONWARNINGS": "error",
    }
    source = "import json, os\nprint(json.dumps(dict(os.environ)), flush=True)\n" + TALKER
    steps: list[dict[str, Any]] = [START, HEARD, OBSERVE, INTERRUPT]
    lab = make_lab(tmp_path, {"talker": source}, {"only": steps}, checks=[published("/chatter")])
    caller = environment(own_temporary_folder(tmp_path), **hostile)
    caller.pop("HOME", None)
    run = subprocess.run(
        command(lab), env=caller, capture_output=True, text=True, timeout=90, check=False
    )
    assert run.returncode == 0, run.stderr
    result = json.loads((lab.results / "submission" / "result.json").read_text(encoding="utf-8"))
    assert result["score"] == {"earned": 1, "possible": 1, "undecided": 0, "final": 1}, result[
        "criteria"
    ]
    process = next(p for p in record_of(lab).processes if p.role == "student")
    seen = json.loads(process.output[0].text)
    assert not hostile.items() & seen.items()
    assert not [line.text for line in process.output if "hostile" in line.text]


def test_statistics_come_although_the_grader_ignores_sigint(tmp_path: Path) -> None:
    """A grader started with SIGINT ignored, as by a shell's `&`, stops a correct subscriber by Ctrl-C all the same."""
    source = (ROOT / "reference/solution/joint_subscriber.py").read_text(encoding="utf-8")
    message = {"type": FLOATS, "message": {"data": [0.5] * 7}, "count": 30, "rate_hz": 100}
    steps: list[dict[str, Any]] = [
        START,
        {"wait_for": {"subscription": "/joint_states", "type": FLOATS, "timeout_s": 20}},
        {"publish": {"topic": "/joint_commands", **message}},
        {"publish": {"topic": "/joint_states", **message}},
        {"interrupt": {"process": "talker", "timeout_s": 30}},
    ]
    lab = make_lab(tmp_path, {"talker": source}, {"only": steps})
    ignoring = ["sh", "-c", f"trap '' INT; exec {shlex.join(command(lab))}"]
    caller = environment(own_temporary_folder(tmp_path))
    run = subprocess.run(
        ignoring, env=caller, capture_output=True, text=True, timeout=90, check=False
    )
    assert run.returncode == 0, run.stderr
    process = next(p for p in record_of(lab).processes if p.role == "student")
    assert process.ended_by == "interrupt"
    assert "Error Statistics:" in [line.text for line in process.output]


# -- what gets out ----------------------------------------------------------------------------


def test_sandboxes_do_not_hear_each_other(tmp_path: Path) -> None:
    """Two sandboxes that publish on one topic at the same time record each its own messages only."""
    steps: list[dict[str, Any]] = [
        START,
        HEARD,
        OBSERVE,
        {"wait_exit": {"process": "talker", "timeout_s": 60}},
    ]
    observed: set[str] = set()

    def end_both(progress: Progress) -> None:
        if "until talker ends" in progress.text:
            observed.add(progress.session)
            if len(observed) == 2:
                time.sleep(0.5)  # the sandboxes go on meanwhile
                interrupt_students()

    recorded = make_lab(tmp_path, {"talker": TALKER}, {"one": steps, "other": steps}).record(
        end_both
    )
    streams = {name: session.bag.stream("/chatter") for name, session in recorded.items()}
    said = {name: set(stream.field("data")) for name, stream in streams.items()}
    assert [len(texts) for texts in said.values()] == [1, 1]
    assert said["one"] != said["other"]
    one, other = (stream.source_ns for stream in streams.values())
    assert max(one[0], other[0]) < min(one[-1], other[-1]), "the two did not run at the same time"
    for session in recorded.values():
        for snapshot in session.record.graph:
            assert snapshot.nodes in ([], ["/talker"])


CONFINED = """
import json, os, pathlib, socket
def attempt(action):
    try:
        action()
    except OSError as problem:
        return type(problem).__name__ + ' ' + os.strerror(problem.errno or 0)
    return 'done'
def write(path):
    return attempt(lambda: pathlib.Path(path).write_text('x'))
def connect():
    with socket.socket() as sock:
        sock.settimeout(3)
        sock.connect(('192.0.2.1', 80))
status = dict(line.split(':', 1) for line in open('/proc/self/status').read().splitlines())
facts = {
    'interfaces': [name for _, name in socket.if_nameindex()],
    'connect': attempt(connect),
    'shm': os.listdir('/dev/shm'),
    'tmp': os.listdir('/tmp'),
    'pids': sorted(int(name) for name in os.listdir('/proc') if name.isdigit()),
    'pid': os.getpid(),
    'uid': os.getuid(),
    'capabilities': status['CapEff'].strip(),
    'new_privileges': status['NoNewPrivs'].strip(),
    'read_only': {p: write(p + '/mark') for p in ('/', '/usr', '/etc', '/home', '/inside', os.environ['PREFIX'])},
    'own': {p: write(p + '/MARK') for p in ('/tmp', '/dev/shm', os.environ['HOME'], '/ws')},
    'secrets': [p for p in SECRETS if os.path.exists(p)],
    'hostname': socket.gethostname(),
}
print(json.dumps(facts), flush=True)
"""


def require_own_files(facts: dict[str, Any], mark: str) -> None:
    """Fail unless the student had only its own writable folders, and left nothing outside of them."""
    # The interpreter is shown at its own path, which may lie below /tmp.
    tmp, prefix = Path("/tmp"), Path(sys.prefix)
    shown = [prefix.relative_to(tmp).parts[0]] if prefix.is_relative_to(tmp) else []
    assert (facts["shm"], facts["tmp"], facts["secrets"]) == ([], shown, [])
    assert "done" not in facts["read_only"].values()
    assert set(facts["own"].values()) == {"done"}
    assert not (Path("/dev/shm") / mark).exists()
    assert not (tmp / mark).exists()


def require_no_rights(facts: dict[str, Any]) -> None:
    """Fail unless the student is an ordinary user that cannot gain rights."""
    assert facts["uid"] != 0
    assert int(facts["capabilities"], 16) == 0
    assert facts["new_privileges"] == "1"


def test_a_student_is_alone_in_its_sandbox(tmp_path: Path) -> None:
    """The student has loopback only, its own processes, /dev/shm and /tmp, a read-only system and no rights."""
    secrets = [
        str(ROOT / "reference/oracles.py"),
        str(ROOT / "rubric.yaml"),
        str(tmp_path),
        "/etc/passwd",
        "/etc/shadow",
    ]
    source = CONFINED.replace("os.environ['PREFIX']", repr(sys.prefix)).replace(
        "SECRETS", repr(secrets)
    )
    mark = f"mark-{os.urandom(6).hex()}"
    recorded = record_one(
        tmp_path, source.replace("MARK", mark), [{"wait_exit": {"process": "node"}}]
    )
    facts: dict[str, Any] = json.loads(texts(recorded)[0])
    assert facts["interfaces"] == ["lo"]
    assert "unreachable" in facts["connect"]
    assert facts["hostname"] == "lab"
    assert len(facts["pids"]) <= 3
    assert max(facts["pids"]) < 100
    require_own_files(facts, mark)
    require_no_rights(facts)


# -- what ends, and what is left --------------------------------------------------------------


#: Has as many processes as it may have.
FILLS_ITS_CELL = """
import os, time
for _ in range(1000):
    try:
        if os.fork() == 0:
            time.sleep(1000)
            os._exit(0)
    except OSError:
        break
print('full', flush=True)
time.sleep(1000)
"""


def test_who_fills_a_sandbox_with_processes_keeps_its_own_programs_out(tmp_path: Path) -> None:
    """A program that finds no room in the sandbox any more is no problem of the grader's; the limit is named."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"wait_for": {"output_of": "talker", "text": "full", "timeout_s": 30}},
        {"start": {"student": "other"}},
        {"wait_for": {"output_of": "other", "text": "began", "timeout_s": 30}},
    ]
    sources = {"talker": FILLS_ITS_CELL, "other": "print('began', flush=True)\n"}
    record = make_lab(tmp_path, sources, {"only": steps}).record()["only"].record
    talker, other = (run for run in record.processes if run.role == "student")
    assert record.problems == []
    assert talker.limit == "processes"
    # Where the limit counts by namespace of users, each program has room of its own.
    began = [line.text for line in other.output if line.stream == "stdout"]
    assert (began, other.limit) in ((["began"], None), ([], "processes"))


def test_a_window_goes_on_until_enough_of_it_is_undisturbed(tmp_path: Path) -> None:
    """Half a second never has 0.7 s undisturbed; it goes on by pieces, and no longer than it may."""
    started: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"wait_for": {"publisher": "/chatter", "timeout_s": 30}},
    ]
    windows = {
        "bound": {"duration_s": 0.5, "extend_s": 0.6},
        "enough": {"duration_s": 0.5, "extend_s": 20},
    }
    steps = [{"observe": window, "label": label} for label, window in windows.items()]
    lab = make_lab(tmp_path, {"talker": TALKER}, {"only": [*started, *steps]})
    recorded = lab.record()["only"]
    for label in windows:
        window = recorded.window(label)
        assert window is not None
        assert window.duration_s >= 1.0
    assert recorded.record.problems == []


#: Tells its nice value four times a second.
NICE = """
import os, threading, time
def tell():
    while True:
        print('nice', os.getpriority(os.PRIO_PROCESS, 0), flush=True)
        time.sleep(0.25)
threading.Thread(target=tell, daemon=True).start()
"""
GREEDY = """
def compute():
    while True:
        sum(range(1000))
threading.Thread(target=compute, daemon=True).start()
"""


@pytest.mark.parametrize("more", ["", GREEDY])
def test_what_is_measured_goes_before_others_unless_it_wants_all_of_a_core(
    tmp_path: Path, more: str
) -> None:
    """A measured node gets more of a core in a window that waits for calm, unless it takes much."""
    steps: list[dict[str, Any]] = [
        {"start": {"student": "talker"}},
        {"wait_for": {"publisher": "/chatter", "timeout_s": 30}},
        {"observe": {"duration_s": 2, "extend_s": 1}, "label": "window"},
    ]
    recorded = make_lab(tmp_path, {"talker": NICE + more + TALKER}, {"only": steps}).record()[
        "only"
    ]
    (run,), window = recorded.processes_of("talker"), recorded.window("window")
    assert window is not None
    said = {
        int(line.text.split()[1])
        for line in run.output
        if line.text.startswith("nice") and line.t_ns < window.end_ns
    }
    shares = [
        (now.cpu_ns - before.cpu_ns) / (now.t_ns - before.t_ns)
        for before, now in itertools.pairwise(run.usage)
        if window.start_ns < now.t_ns < window.end_ns
    ]
    if not may_raise():
        assert said == {0}
    elif not more:
        assert MEASURED in said
    else:
        assert said == {0, STANDING} or min(shares) < 0.3  # where other work leaves it no more


def test_a_session_beyond_its_time_is_ended(tmp_path: Path) -> None:
    """A node that keeps its session waiting past the limit is ended, and the rest is recorded."""
    recorded = record_one(
        tmp_path,
        TALKER,
        [{"wait_for": {"publisher": "/never", "type": FLOATS, "timeout_s": 300}}],
        timeout_s=8,
    )
    assert recorded.record.complete
    assert recorded.record.problems == []
    assert [step.outcome for step in recorded.record.steps[1:]] == ["timeout"]
    assert [(run.limit, run.ended_by) for run in recorded.processes_of("node")] == [
        ("time", "limit")
    ]
    assert len(recorded.bag.stream("/chatter")) > 10


IGNORES_SIGINT = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
IGNORES_ALL = IGNORES_SIGINT + "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
READY = "import time\nprint('ready', flush=True)\ntime.sleep(600)\n"
DAEMON = """
import os, signal, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        time.sleep(600)
    os._exit(0)
os.wait()
"""
FLOOD = "import os\nfor _ in range(10_000):\n    os.write(1, b'x' * 1023 + b'\\n')\n"
#: Ctrl-C, which may come at once, is heeded when all is written.
WHOLE_FLOOD = f"""
import signal
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
print('ready', flush=True)
{FLOOD}
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
"""
ONE_LINE_FLOOD = "import os\nfor _ in range(10_000):\n    os.write(1, b'x' * 1024)\n"
#: Stands in the sandbox until it has been looked at: it may be there for a tenth of a second only.
HELD = "import time\nprint('up', flush=True)\ntime.sleep(600)\n"
HOLD: list[dict[str, Any]] = [
    {"start": {"student": "held"}},
    {"wait_for": {"output_of": "held", "text": "up", "timeout_s": 30}},
    {"wait_exit": {"process": "held", "timeout_s": 60}},
]
CLOSES = "import os, time\nprint('ready', flush=True)\nos.close(1)\nos.close(2)\ntime.sleep(600)\n"
STOPS_ITSELF = (
    "import os, signal\nprint('ready', flush=True)\nos.kill(os.getpid(), signal.SIGSTOP)\n"
)
KILLS_ALL = "import os, signal\nprint('ready', flush=True)\nos.kill(-1, signal.SIGKILL)\n" + READY
MISBEHAVIOUR = {
    "ignores_sigint": (IGNORES_SIGINT + READY, "ready", "terminate"),
    "ignores_all_signals": (IGNORES_ALL + READY, "ready", "kill"),
    "leaves_a_daemon": (DAEMON + READY, "ready", "interrupt"),
    "leaves_a_daemon_and_exits": (DAEMON, "", "itself"),
    "floods_its_output": (WHOLE_FLOOD + READY, "ready", "interrupt"),
    "floods_one_line": (ONE_LINE_FLOOD, "", "itself"),
    "closes_its_output": (CLOSES, "ready", "interrupt"),
    "stops_itself": (STOPS_ITSELF, "ready", None),
    "kills_all_it_can": (KILLS_ALL, "ready", None),
    "exits_at_once": ("raise SystemExit(3)\n", "", "itself"),
    "does_not_start": ("this is no Python\n", "", "itself"),
}


def require_bounded_output(run: ProcessRun, *, flooded: bool) -> None:
    """Fail unless at most a megabyte of output is kept, and the rest of a flood is counted."""
    kept = sum(len(line.text) + 1 for line in run.output)
    assert kept <= 2**20
    if flooded:
        assert kept + run.output_dropped_bytes >= 10_000 * 1024 - 2 * 1024


@pytest.mark.parametrize("name", part([*MISBEHAVIOUR], 3, EVERY_ATTACK))
def test_nothing_is_left_of_a_misbehaving_student(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However a student's process behaves, the recording is complete, and no process, mount or folder stays."""
    source, text, ended_by = MISBEHAVIOUR[name]
    temporary = own_temporary_folder(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    steps: list[dict[str, Any]] = [
        *HOLD,
        START,
        {"wait_for": {"output_of": "talker", "text": text or "no such line", "timeout_s": 20}},
        {"interrupt": {"process": "talker", "timeout_s": 20 if ended_by == "interrupt" else 1}},
    ]
    watch = Watch()

    def look(progress: Progress) -> None:
        watch.look()
        if "until held ends" in progress.text:
            interrupt_students()

    recorded = make_lab(tmp_path, {"talker": source, "held": HELD}, {"only": steps}).record(look)[
        "only"
    ]
    run = recorded.process("talker")
    assert run is not None
    assert recorded.record.complete
    assert not recorded.record.problems
    assert ended_by in (None, run.ended_by)
    assert watch.networks
    watch.until_all_ended()
    assert remains(temporary) == []
    assert mounts_below([temporary]) == []
    require_bounded_output(run, flooded="flood" in name)


def grading(tmp_path: Path) -> tuple[Lab, Path, subprocess.Popen[str], Watch]:
    """Start a grading of two sessions, and wait until a student's node is observed in each."""
    steps: list[dict[str, Any]] = [
        START,
        HEARD,
        {"observe": {"duration_s": 60, "first_message_on": "/chatter"}},
        INTERRUPT,
    ]
    lab = make_lab(
        tmp_path,
        {"talker": TALKER},
        {"only": steps, "other": steps},
        timeout_s=90,
        checks=[published("/chatter")],
    )
    temporary = own_temporary_folder(tmp_path)
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        command(lab), env=environment(temporary), stdout=pipe, stderr=pipe, text=True
    )
    bags = lab.results / "submission" / UNFINISHED / "recordings"

    def recording() -> bool:
        assert process.poll() is None, process.communicate()
        return (
            len([path for path in bags.glob(".*.partial/*.mcap") if path.stat().st_size > 4_000])
            == 2
        )

    until(recording, 60)
    watch = Watch(process.pid)
    watch.look()
    assert len(watch.networks) == 2
    assert sum("/ws/install" in command_of(pid) for pid in below(process.pid)) >= 2
    return lab, temporary, process, watch


def test_no_process_survives_a_killed_grader(tmp_path: Path) -> None:
    """After a kill -9 of the grader its sandboxes end by themselves, and there is no result to be taken for one."""
    lab, _, process, watch = grading(tmp_path)
    process.kill()
    process.communicate()
    watch.until_all_ended()
    assert not list(lab.results.rglob("result.json"))
    assert not list(lab.results.rglob("report.html"))


def grade_and_kill(lab: Lab, caller: dict[str, str], after_s: float) -> None:
    """Start a grading, kill it after a while, and wait until nothing of it is left."""
    process = subprocess.Popen(
        command(lab), env=caller, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    watch = Watch(process.pid)
    end = time.monotonic() + after_s
    while (left_s := end - time.monotonic()) > 0:
        time.sleep(min(left_s, 0.1))
        watch.look()
    process.kill()
    process.wait()
    watch.until_all_ended()


def test_a_grader_killed_at_any_moment_leaves_nothing_that_counts(tmp_path: Path) -> None:
    """Killed at ten moments of its run, others each time, it leaves no process and no half result."""
    moments = examples(40)
    lab = make_lab(
        tmp_path,
        {"talker": TALKER},
        {"only": [START, HEARD, OBSERVE, INTERRUPT]},
        checks=[published("/chatter")],
    )
    caller = environment(own_temporary_folder(tmp_path))
    result = lab.results / "submission" / "result.json"
    begun = time.monotonic()
    subprocess.run(command(lab), env=caller, capture_output=True, timeout=90, check=True)
    whole_s, whole = (
        time.monotonic() - begun,
        json.loads(result.read_text(encoding="utf-8"))["score"],
    )
    assert whole["earned"] == 1
    for moment in range(moments):
        grade_and_kill(lab, caller, whole_s * (moment + random.random()) / moments)
        # A result is whole, and belongs to this run or an earlier one.
        if result.exists():
            assert json.loads(result.read_text(encoding="utf-8"))["score"] == whole
    subprocess.run(command(lab), env=caller, capture_output=True, timeout=90, check=True)
    assert json.loads(result.read_text(encoding="utf-8"))["score"] == whole


@pytest.mark.parametrize(
    "number", part([signal.SIGINT, signal.SIGTERM], 2, EVERY_ATTACK), ids=lambda number: number.name
)
def test_an_interrupted_grader_leaves_all_as_it_was(number: signal.Signals, tmp_path: Path) -> None:
    """Ctrl-C ends the grader with 130 and SIGTERM with 143; no process or folder stays, and an earlier result does."""
    earlier = [
        tmp_path / "results/submission" / name
        for name in ("result.json", "report.html", "recordings/x.json")
    ]
    for path in earlier:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("earlier", encoding="utf-8")
    lab, temporary, process, watch = grading(tmp_path)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + number, errors
    assert "Traceback" not in errors
    watch.until_all_ended()
    assert remains(temporary) == []
    assert sorted(path for path in lab.results.rglob("*") if path.is_file()) == sorted(earlier)
    assert {path.read_text(encoding="utf-8") for path in earlier} == {"earlier"}


def test_a_killed_session_process_leaves_its_recording_cut_off(tmp_path: Path) -> None:
    """If a session's own process dies, its sandbox dies with it and the recording is not complete."""
    steps: list[dict[str, Any]] = [
        START,
        HEARD,
        {"observe": {"duration_s": 60, "first_message_on": "/chatter"}},
        INTERRUPT,
    ]
    lab = make_lab(tmp_path, {"talker": TALKER}, {"only": steps}, timeout_s=90)
    watch = Watch()

    def kill(progress: Any) -> None:
        if "observing" in progress.text:
            watch.look()
            (session,) = (p for p in below(os.getpid()) if name_of(p) == "session")
            os.kill(session, signal.SIGKILL)

    recorded = lab.record(kill)["only"]
    assert not recorded.record.complete
    assert watch.networks
    watch.until_all_ended()
