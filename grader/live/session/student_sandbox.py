"""The sandbox of one session's student: the folders, the limits, and the programs that are started in it."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath

from confine.command import confined
from confine.helpers import search_path
from confine.isolation import confined_uid, sandbox_cgroup
from confine.machine import descendants_of
from confine.namespaces import (
    adopt_orphans,
    bring_loopback_up,
    mount_tmpfs,
    use_up_process_ids,
)
from confine.room import TEMPORARY
from confine.scratch import remove_tree
from grader.live.process.guard import Guard
from grader.live.process.process import OutputRoom, PipeReader, RunningProcess
from grader.live.sandbox.environment import student_environment, with_prefixes
from grader.live.sandbox.room import (
    CRASHES,
    HOME,
    INSIDE,
    INTERFACES,
    PARAMETERS,
    WORKSPACE,
    StudentRoom,
)
from grader.live.session.plan import SessionPlan
from grader.live.session.stack_watch import StackWatch
from grader.live.student_tap.claims import claims_in
from grader.live.student_tap.crashes import LIBRARY, crash_variables, frames_in
from grader.recording.session import Claim, ProcessRun
from grader.submission.beneath import copy_tree, restore_way

_WORKSPACE_BYTES = 256 * 1024 * 1024
_SMALL_BYTES = 64 * 1024 * 1024
_MAX_FILES = 20_000
#: More than the processes that come before a student's program in its sandbox.
_STUDENTS_IDS = 12
_MAX_CLAIM_BYTES, _MOST_CLAIMS = 512 * 1024, 5000
_CLEAN_UP_S = 5.0
#: Rights of a folder to which both the student's user and bubblewrap, root without privileges, can change.
_OPEN = 0o755
#: Limits of a session's students together: where one was hit, nothing more may begin.
_LEAVES_NO_ROOM = ("processes", "memory")

#: Mode of a pipe that any account may open for writing.
_WRITABLE = 0o622


def _do_nothing() -> None:
    """Stand for a function that is not given."""


class StudentSandbox:
    """The sandbox for the student's programs of one session.

    The session's `processes` are in the order of their start, reference nodes included; `trusted` are the grader's own
    ones. Launch files are evaluated in `launch_workspace`, a copy of the `workspace`, since reading one runs what it
    will; the files that one brings for its nodes are in `parameters`. `seen` is where the student's processes see these
    folders.
    """

    def __init__(self, plan: SessionPlan) -> None:
        self.plan, self.record, self.isolation = plan, plan.record, plan.isolation
        self.uid = confined_uid(plan.isolation, plan.slot)
        self.processes: dict[str, RunningProcess] = {}
        self.trusted: list[RunningProcess] = []
        self._room = StudentRoom.below(plan.scratch, plan.installation)
        self.workspace, self.launch_workspace = self._room.areas[WORKSPACE], plan.scratch / "trial"
        self.parameters, self.interfaces = (
            self._room.tools[PARAMETERS],
            self._room.tools[INTERFACES],
        )
        self._prefixes = sorted(plan.interfaces.iterdir()) if plan.interfaces is not None else []
        self.seen = self._room.seen(plan.isolation)
        #: Called before each program of the student.
        self.before_start: Callable[[], object] = _do_nothing
        #: Programs that never began, and how the session would be disturbed by that.
        self._unstarted: list[tuple[ProcessRun, str]] = []
        self._taps: dict[str, PipeReader] = {}
        self.stacks = StackWatch(plan.record, self._tapped, self._above)
        self._output = OutputRoom()
        self._group = sandbox_cgroup(plan.isolation, plan.slot)
        self.guard = Guard(
            self.students,
            self._group,
            self._room.areas,
            sized=plan.isolation.namespaces,
            user=self.uid,
            on_problem=plan.record.problems.append,
        )

    def students(self) -> list[RunningProcess]:
        """Return the student's processes, those that have ended included."""
        return [p for p in self.processes.values() if p.run.role == "student"]

    def cpu_ns(self) -> int | None:
        """Return the CPU time of all that the student started, in ns; None where no control group sums it up."""
        return self._group.cpu_ns() if self._group is not None else None

    # -- folders ------------------------------------------------------------------------------

    def prepare(self) -> None:
        """Bring the loopback up, and lay out the student's folders, each a file system of its own size."""
        self.launch_workspace.mkdir()
        if self.isolation.namespaces:
            bring_loopback_up()
            use_up_process_ids(_STUDENTS_IDS)
            sizes = {self.workspace: _WORKSPACE_BYTES, self.launch_workspace: _WORKSPACE_BYTES}

            def mount(folder: Path) -> None:
                mount_tmpfs(str(folder), sizes.get(folder, _SMALL_BYTES), _MAX_FILES)

            mount(Path("/dev/shm"))
            mount(self.launch_workspace)
            self._room.make(self.plan.scratch, mount)
        else:
            adopt_orphans()
            self._room.make(self.plan.scratch)
        for prefix in self._prefixes:
            shutil.copytree(prefix, self.interfaces / prefix.name)
        if self.plan.crash_library is not None:
            library = self._room.tools[CRASHES] / LIBRARY
            shutil.copyfile(self.plan.crash_library, library)
            library.chmod(0o644)  # whatever the umask is
        if self._group is not None:
            self._group.make()
        self.copy_workspace(self.plan.staged, self.workspace)

    def copy_workspace(self, source: Path, target: Path) -> None:
        """Make a folder a copy of a staged submission, owned by the student; links are copied as links."""
        for left in target.iterdir():
            if left.is_dir() and not left.is_symlink():
                remove_tree(left)
            else:
                left.unlink()
        copy_tree(source, target, self.uid)

    # -- starting programs --------------------------------------------------------------------

    def environment(self, more: Mapping[str, str]) -> dict[str, str]:
        """Return the environment of a student's process, with some variables more."""
        base = student_environment(
            self.plan.installation,
            self.seen[HOME],
            self.seen[WORKSPACE],
            self.seen[INSIDE],
            self.plan.domain_id,
        )
        found = with_prefixes(base, [f"{self.seen[INTERFACES]}/{p.name}" for p in self._prefixes])
        return {**found, "TMPDIR": self.seen[TEMPORARY], **more}

    def with_interfaces(self, environment: Mapping[str, str]) -> dict[str, str]:
        """Add the built interfaces to the environment of a process of the grader."""
        return with_prefixes(environment, [str(self.interfaces / p.name) for p in self._prefixes])

    async def start(
        self,
        run: ProcessRun,
        *,
        cwd: str | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> RunningProcess:
        """Start one of the student's processes, confined and with the tap."""
        tap_read, tap_write = os.pipe()
        # Another account runs the program; its children open the pipe by their parent's folder in /proc.
        os.fchmod(tap_write, _WRITABLE)
        own = {"GRADER_TAP_FD": str(tap_write), **self._crash_variables()}
        variables = self.environment({**own, **(environment or {})})
        try:
            running = await self.start_confined(run, variables, cwd, pass_fds=(tap_write,))
        except BaseException:
            os.close(tap_read)
            raise
        finally:
            os.close(tap_write)
        self._taps[run.name] = PipeReader(
            tap_read, _MAX_CLAIM_BYTES, lambda text: self._note_claims(run, text)
        )
        self.processes[run.name] = running
        return running

    def _crash_variables(self) -> dict[str, str]:
        """Return the variables that load the library for crashes; it does nothing in programs of the system."""
        if self.plan.crash_library is None:
            return {}
        return crash_variables(self.seen[CRASHES], f"{self.seen[WORKSPACE]}/install")

    async def start_confined(
        self,
        run: ProcessRun,
        environment: Mapping[str, str],
        cwd: str | None,
        *,
        workspace: Path | None = None,
        folders: Mapping[str, Path] | None = None,
        pass_fds: tuple[int, ...] = (),
        with_input: bool = False,
    ) -> RunningProcess:
        """Start a command of the student's, confined, and record it.

        It sees another `workspace` instead of the session's, and `folders` besides, if these are given.
        """
        self.before_start()
        self.record.processes.append(run)
        if (
            workspace is None
            and cwd is not None
            and PurePosixPath(cwd).is_relative_to(self.seen[WORKSPACE])
        ):
            # An earlier program may have changed it, which must not prevent the start of this one.
            try:
                restore_way(
                    self.workspace, PurePosixPath(cwd).relative_to(self.seen[WORKSPACE]), _OPEN
                )
            except OSError:
                cwd = self.seen[WORKSPACE]
        room = replace(
            self._room,
            areas={**self._room.areas, WORKSPACE: workspace or self.workspace},
            tools={**self._room.tools, **(folders or {})},
        )
        with confined(
            self.isolation,
            run.argv,
            environment=environment,
            room=room,
            slot=self.plan.slot,
            cwd=cwd or self.seen[HOME],
            group=self._group,
        ) as (argv, passed, info):
            return await RunningProcess.start(
                run,
                argv,
                environment={"PATH": search_path()},
                pass_fds=(*passed, *pass_fds),
                child_pid_fd=info,
                with_input=with_input,
                room=self._output,
            )

    def _note_claims(self, run: ProcessRun, text: str) -> None:
        if run.artifact is not None and not text.startswith('{"kind": "started"'):
            self.note_unstarted(run, f"{run.name} could not be started")
        run.crash = frames_in(text, self._above)
        claims = self._claims_in(run.name, text)
        self.record.claims += claims[: max(0, _MOST_CLAIMS - len(self.record.claims))]

    def _claims_in(self, process: str, text: str) -> list[Claim]:
        return claims_in(text, process, self._above)

    @property
    def _above(self) -> str:
        """The beginning of the paths of the submission's files."""
        return f"{self.seen[WORKSPACE]}/src/"

    def _tapped(self, process: str) -> str:
        """Return the text of a program's tap until now; empty without a tap, or after its end."""
        tap = self._taps.get(process)
        if tap is None:
            return ""
        return tap.so_far()

    def claims_so_far(self) -> list[Claim]:
        """Return the claims of all processes of the student until now, also of running ones."""
        running = (
            claim
            for name, tap in self._taps.items()
            for claim in self._claims_in(name, tap.so_far())
        )
        return [*self.record.claims, *running]

    def note_unstarted(self, run: ProcessRun, what: str) -> None:
        """Note that a program of the student never began; `blame_unstarted` finds the cause at the end."""
        output = run.output[-1].text if run.output else "nothing"
        self._unstarted.append((run, f"{what} in its sandbox: {output}"))

    def blame_unstarted(self) -> None:
        """Lay it at the student's door where its own processes left no room for more; else it is a problem."""
        limits = (run.limit for run in self.record.processes if run.role == "student")
        filled = next((limit for limit in limits if limit in _LEAVES_NO_ROOM), None)
        for run, problem in self._unstarted:
            run.limit = run.limit or filled
            if filled is None:
                self.record.problems.append(problem)

    # -- the end ------------------------------------------------------------------------------

    def clean_up(self) -> None:
        """See to it that none of the student's processes is left."""
        if self._group is not None:
            self._group.remove()
        self.end_orphans()

    def end_orphans(self) -> None:
        """End processes that the student's programs left behind, if no namespace does; no program may be running."""
        if self.isolation.namespaces:
            return
        end_s = time.monotonic() + _CLEAN_UP_S
        while (left := self._orphans()) and time.monotonic() < end_s:
            for pid in left:
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
                with suppress(ChildProcessError):
                    os.waitpid(pid, os.WNOHANG)

    def _orphans(self) -> list[int]:
        """Return the processes below this one other than the grader's."""
        roots = [root for p in self.trusted if p.alive and (root := p.root_pid()) is not None]
        ours = {os.getpid(), *(pid for root in roots for pid in descendants_of(root))}
        return [pid for pid in descendants_of(os.getpid()) if pid not in ours]
