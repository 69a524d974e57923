"""CPU times of a program, looked at again and again as the first process of a sandbox, against the kernel's sums."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from confine.namespaces import open_descriptors
from confine.program_usage import ProgramUsage

pytestmark = pytest.mark.live

FORM = "ROOT" if os.geteuid() == 0 else "USER"
#: Begins a step at each line of its input, and answers as soon as it is done.
STEPS = """
import hashlib, os, sys, threading, time
block = bytes(2**18)
def is_asleep(task):
    try:
        with open(f"/proc/{task}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] == "S"
    except OSError:
        return False
def until_asleep(threads):
    # The thread that asks is awake, and an ended one is there for a moment.
    tasks = []
    while len(tasks) != threads or sum(map(is_asleep, tasks)) != threads - 1:
        time.sleep(0.01)
        tasks = [f"self/task/{name}" for name in os.listdir("/proc/self/task")]
def compute(until_s):
    while time.thread_time() < until_s:
        hashlib.sha256(block)
begun, go, done = threading.Event(), threading.Event(), threading.Event()
def later():
    compute(0.03)
    begun.set()
    go.wait()
    compute(0.13)
    done.set()
    time.sleep(600)
def child(then):
    compute(0.1)
    then()
late = threading.Thread(target=later, daemon=True)
for step in sys.stdin:
    if step == "threads\\n":
        late.start()
        for _ in range(8):
            threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
        begun.wait()
        until_asleep(10)
    elif step == "one thread\\n":
        go.set()
        done.wait()
        until_asleep(10)
    elif step == "ended thread\\n":
        thread = threading.Thread(target=compute, args=(0.1,))
        thread.start()
        thread.join()
        until_asleep(10)
    elif step == "child\\n":
        reading, writing = os.pipe()
        kept = os.fork()
        if kept == 0:
            child(lambda: os.write(writing, b"done") and time.sleep(600))
        os.read(reading, 4)
        while not is_asleep(kept):
            time.sleep(0.01)
    elif step == "ended child\\n":
        os.kill(kept, 9)
        os.wait()
        if os.fork() == 0:
            child(lambda: os._exit(0))
        os.wait()
    print(step, flush=True)
"""
#: Looks at the program before and after each step, and prints the step, the CPU time and the searches in it.
LOOKS = """
import json, os, subprocess, sys, time
from confine.namespaces import Form, enter_sandbox
from confine.program_usage import ProgramUsage
from confine.machine import tasks_of

enter_sandbox(Form.{form})
program = subprocess.Popen(
    [sys.executable, "-c", {steps!r}], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
)
usage = ProgramUsage()

def step(name):
    program.stdin.write(name + "\\n")
    program.stdin.flush()
    said = program.stdout.readline()
    program.stdout.readline()
    return said

step("nothing")
for name in {names}:
    usage.look(program.pid)
    before_ns, searches = usage.cpu_ns, usage.searches
    step(name)
    usage.look(program.pid)
    own = {{tid: usage.times[tid] for tids in usage.tasks.values() for tid in tids}}
    read = {{}}
    for tid in own:
        with open(f"/proc/{{tid}}/schedstat") as file:
            read[tid] = tuple(map(int, file.read().split()[:2]))
    found = {{
        "name": name,
        "used_s": (usage.cpu_ns - before_ns) / 1e9,
        "searches": usage.searches - searches,
        "missed_s": max(abs(read[tid][0] - own[tid][0]) for tid in own) / 1e9,
        "threads": len(own),
    }}
    print(json.dumps(found))
program.kill()
"""


def looks(*names: str) -> list[dict[str, Any]]:
    """Return the findings of looks before and after steps of the program."""
    program = LOOKS.format(form=FORM, steps=STEPS, names=names)
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    if "unshare" in run.stderr:
        pytest.skip(f"no namespaces here: {run.stderr.strip().splitlines()[-1]}")
    assert run.returncode == 0, run.stderr
    return [json.loads(line) for line in run.stdout.splitlines()]


def test_each_use_of_cpu_time_is_found() -> None:
    """A look finds the CPU time of threads and children, also of those that ended in between."""
    names = ("threads", "one thread", "ended thread", "child", "ended child")
    for found, used_s in zip(looks(*names), (0.03, 0.1, 0.1, 0.1, 0.1), strict=True):
        # The kernel counts the time of an ended child in ticks of 10 ms, of user and system each.
        assert used_s - 0.02 <= found["used_s"] < used_s + 0.06, found
        assert found["missed_s"] < 0.002, found


def test_a_program_with_the_same_threads_is_not_searched() -> None:
    """Only new threads and processes, and ended ones, are searched for; a thread that wakes up is found without it."""
    names = ("nothing", "threads", "one thread", "nothing", "child", "nothing")
    searched = [found["searches"] > 0 for found in looks(*names)]
    assert searched == [False, True, False, False, True, False]


#: Begins 60 threads that compute a little, and ends half of them at a line of its input.
CROWD = """
import os, sys, threading, time
go = threading.Event()
def work(end):
    sum(range(10_000))
    end.wait()
for end in (go, threading.Event()):
    for _ in range(30):
        threading.Thread(target=work, args=(end,), daemon=True).start()
print("crowd", flush=True)
sys.stdin.readline()
go.set()
while len(os.listdir("/proc/self/task")) > 31:
    time.sleep(0.01)
print("half", flush=True)
sys.stdin.readline()
"""


def _start_crowd() -> subprocess.Popen[bytes]:
    program = subprocess.Popen(
        [sys.executable, "-c", CROWD], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert _next_line(program) == b"crowd\n"
    return program


def _next_line(program: subprocess.Popen[bytes]) -> bytes:
    assert program.stdout is not None
    return program.stdout.readline()


def test_few_files_of_threads_stay_open() -> None:
    """Two programs with many threads are read as a whole, with few open files, and with none after the end."""
    open_before = len(open_descriptors(0))
    programs = [_start_crowd(), _start_crowd()]
    usages = [ProgramUsage(), ProgramUsage()]
    pipes = 4
    for program, usage in zip(programs, usages, strict=True):
        usage.look(program.pid)
        assert len(usage.times) == 61
    assert len(open_descriptors(0)) < open_before + pipes + 2 * 30
    for program, usage in zip(programs, usages, strict=True):
        assert program.stdin is not None
        program.stdin.write(b"\n")
        program.stdin.flush()
        assert _next_line(program) == b"half\n"
        usage.look(program.pid)
        assert len(usage.tasks[program.pid]) == 31
        assert len(usage.times) == 61
        usage.close()
    assert len(open_descriptors(0)) == open_before + pipes
    for program in programs:
        program.communicate()
