"""The system call filter of students' processes, as a classic BPF program for Linux on x86-64.

It denies what no ROS node needs and what has served to leave sandboxes: namespaces and mounts, tracing,
keys, io_uring, kernel modules and clocks, socket families beyond the four that DDS uses, memory, semaphores and
queues that are no process's, which nobody would count and which outlive everyone, choosing cores, by which a process
could leave the one that it is held to, and what keeps others from files that both may read.

References
----------
`man 2 seccomp`, `man 2 syscalls`; numbers from the kernel's `arch/x86/entry/syscalls/syscall_64.tbl`.
"""

from __future__ import annotations

import ctypes
import errno
import os
import struct

_STEP = struct.Struct("=HBBI")
_AUDIT_ARCH_X86_64 = 0xC000003E
_X32_BIT = 0x40000000

# Offsets in the kernel's `struct seccomp_data`; of an argument, its lower half.
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16

_LOAD, _JUMP_EQUAL, _JUMP_AT_LEAST, _JUMP_ANY_BIT, _AND, _RETURN = (
    0x20,
    0x15,
    0x35,
    0x45,
    0x54,
    0x06,
)
_ALLOW, _KILL_PROCESS, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000

_SOCKET, _SOCKETPAIR, _IOCTL, _CLONE, _KILL, _CLONE3 = 41, 53, 16, 56, 62, 435
_SETPRIORITY, _PRLIMIT, _SETSCHEDULER, _FCNTL = 141, 302, 144, 72
_OPEN, _OPENAT = 2, 257
#: What makes a call of the first two be about the caller's own process, or about one process at all.
_OWN_PROCESS = _ONE_PROCESS = 0
#: The process id -1, as 32 bits.
_ALL_PROCESSES = 0xFFFFFFFF
#: AF_UNIX, AF_INET, AF_INET6, AF_NETLINK (`getifaddrs` needs the last).
_AF_UNIX, _AF_INET, _AF_INET6 = 1, 2, 10
_SOCKET_FAMILIES = (_AF_UNIX, _AF_INET, _AF_INET6, 16)
#: Of a socket's type, its kind; the rest are flags.
_SOCKET_KIND, _DATAGRAM = 0xF, 2
#: TIOCSTI and TIOCLINUX put characters into a terminal's input; the others set attributes of a file that is open for
#: reading, for good in the case of the last: FS_IOC_SETFLAGS, FS_IOC_FSSETXATTR, FS_IOC_ENABLE_VERITY.
_REQUESTS = (0x5412, 0x541C, 0x40086602, 0x401C5820, 0x40806685)
#: F_SETLEASE holds up whoever opens the file, for 45 s each time; F_NOTIFY is of the same kind. For a lease one must
#: own the file, as students' programs do where the grader is an ordinary user, and it need not be open for writing.
_FILE_COMMANDS = (1024, 1026)
#: SCHED_OTHER, also for oneself alone (SCHED_RESET_ON_FORK): Fast DDS sets it for its threads, whose ids a filter
#: cannot tell from others'.
_USUAL_SCHEDULING = (0, 0x40000000)
#: O_TRUNC with O_RDONLY among the flags of an open: to Landlock of Linux before 6.2 that is reading.
_CUTS, _CUTS_BY_READING = 0o1003, 0o1000
#: CLONE_NEWNS, NEWCGROUP, NEWUTS, NEWIPC, NEWUSER, NEWPID, NEWNET.
_NAMESPACES = 0x7E020000

#: System calls that answer EPERM.
DENIED = {
    "acct": 163, "add_key": 248, "adjtimex": 159, "bpf": 321, "chroot": 161, "clock_adjtime": 305,
    "clock_settime": 227, "delete_module": 176, "fanotify_init": 300, "finit_module": 313, "fsconfig": 431,
    "fsmount": 432, "fsopen": 430, "fspick": 433, "init_module": 175, "io_uring_enter": 426,
    "io_uring_register": 427, "io_uring_setup": 425, "ioperm": 173, "iopl": 172, "ioprio_set": 251, "kcmp": 312,
    "kexec_file_load": 320, "kexec_load": 246, "keyctl": 250, "memfd_create": 319, "memfd_secret": 447,
    "modify_ldt": 154, "mount": 165, "mount_setattr": 442, "move_mount": 429, "mq_open": 240, "msgget": 68,
    "name_to_handle_at": 303,
    "open_by_handle_at": 304, "open_tree": 428, "perf_event_open": 298, "pidfd_getfd": 438, "pivot_root": 155,
    "process_madvise": 440, "process_vm_readv": 310, "process_vm_writev": 311, "ptrace": 101, "quotactl": 179,
    "quotactl_fd": 443, "reboot": 169, "request_key": 249, "sched_setaffinity": 203, "sched_setattr": 314,
    "semget": 64, "setns": 308, "settimeofday": 164, "shmget": 29, "swapoff": 168, "swapon": 167, "syslog": 103,
    "umount2": 166, "unshare": 272, "userfaultfd": 323, "vhangup": 153,
}  # fmt: skip


#: What changes a file's rights, owner, times, attributes or length by its name, or by a descriptor for reading.
#: Landlock does not know of it (of the length since Linux 6.2), and whose user id a file has may do it.
DENIED_TO_OWNERS = {
    "chmod": 90, "chown": 92, "fchmod": 91, "fchmodat": 268, "fchmodat2": 452, "fchown": 93, "fchownat": 260,
    "file_setattr": 469, "fremovexattr": 199, "fsetxattr": 190, "futimesat": 261, "lchown": 94, "lremovexattr": 198,
    "lsetxattr": 189, "openat2": 437, "removexattr": 197, "removexattrat": 466, "setxattr": 188, "setxattrat": 463,
    "truncate": 76, "utime": 132, "utimensat": 280, "utimes": 235,
}  # fmt: skip


class FilterProgram(ctypes.Structure):
    """The kernel's `struct sock_fprog`: the number of a filter's steps, and the steps."""

    _fields_ = (("length", ctypes.c_ushort), ("steps", ctypes.c_char_p))

    @classmethod
    def of(cls, steps: bytes) -> FilterProgram:
        """Return the program of some steps."""
        return cls(len(steps) // _STEP.size, steps)


def filter_program(*, own_spaces: bool = True, own_user: bool = True) -> bytes:
    """Return the filter as an array of `struct sock_filter`, which bubblewrap and the kernel take.

    Without `own_spaces` (process ids, a network, a read-only system) a signal to all processes is denied, and of a
    network's sockets all but datagrams: Landlock knows neither TCP's relatives nor connecting by sending. Without
    `own_user` besides, AF_UNIX is denied, by which services are reached that trust the user id, and changing that
    user's files.
    """
    program = [
        step(_LOAD, _ARCHITECTURE),
        step(_JUMP_EQUAL, _AUDIT_ARCH_X86_64, 1, 0),
        step(_RETURN, _KILL_PROCESS),
        step(_LOAD, _NUMBER),
        *_answer_if(_JUMP_AT_LEAST, _X32_BIT, errno.ENOSYS),
    ]
    for number in sorted([*DENIED.values(), *(() if own_user else DENIED_TO_OWNERS.values())]):
        program += _answer_if(_JUMP_EQUAL, number, errno.EPERM)
    if not own_spaces:
        program += _judge_argument(
            _KILL, 0, _answer_if(_JUMP_EQUAL, _ALL_PROCESSES, errno.EPERM), _ALLOW
        )
    if not own_user:
        for number, flags in ((_OPEN, 1), (_OPENAT, 2)):
            cuts = [step(_AND, _CUTS), *_answer_if(_JUMP_EQUAL, _CUTS_BY_READING, errno.EPERM)]
            program += _judge_argument(number, flags, cuts, _ALLOW)
    program += _of_others()
    # Its flags lie in memory, where no filter can look; without it, libraries use `clone`.
    program += _answer_if(_JUMP_EQUAL, _CLONE3, errno.ENOSYS)
    program += _judge_argument(
        _CLONE, 0, _answer_if(_JUMP_ANY_BIT, _NAMESPACES, errno.EPERM), _ALLOW
    )
    for number, words in ((_IOCTL, _REQUESTS), (_FCNTL, _FILE_COMMANDS)):
        refused = [one for word in words for one in _answer_if(_JUMP_EQUAL, word, errno.EPERM)]
        program += _judge_argument(number, 1, refused, _ALLOW)
    program += _of_sockets(own_spaces=own_spaces, local=own_user)
    program.append(step(_RETURN, _ALLOW))
    return b"".join(program)


def _of_others() -> list[bytes]:
    """Deny changing limits and weights of others with the same user id, which may be the grader's own processes."""
    own = [step(_JUMP_EQUAL, _OWN_PROCESS, 0, 1), step(_RETURN, _ALLOW)]
    one = [step(_JUMP_EQUAL, _ONE_PROCESS, 0, 1 + len(own)), step(_LOAD, _ARGUMENTS + 8), *own]
    usual = [
        one
        for way in _USUAL_SCHEDULING
        for one in (step(_JUMP_EQUAL, way, 0, 1), step(_RETURN, _ALLOW))
    ]
    return [
        *_judge_argument(_PRLIMIT, 0, own, _ERRNO | errno.EPERM),
        *_judge_argument(_SETPRIORITY, 0, one, _ERRNO | errno.EPERM),
        *_judge_argument(_SETSCHEDULER, 1, usual, _ERRNO | errno.EPERM),
    ]


def _of_sockets(*, own_spaces: bool, local: bool) -> list[bytes]:
    """Permit sockets of some families."""
    kind = [
        step(_LOAD, _ARGUMENTS + 8),
        step(_AND, _SOCKET_KIND),
        step(_JUMP_EQUAL, _DATAGRAM, 0, 1),
    ]
    datagrams = [*kind, step(_RETURN, _ALLOW), step(_RETURN, _ERRNO | errno.EACCES)]
    program = []
    for number in (_SOCKET, _SOCKETPAIR):
        permitted = []
        for family in _SOCKET_FAMILIES:
            if family == _AF_UNIX and number == _SOCKET and not local:
                continue
            of_network = family in (_AF_INET, _AF_INET6)
            then = datagrams if of_network and not own_spaces else [step(_RETURN, _ALLOW)]
            permitted += [step(_JUMP_EQUAL, family, 0, len(then)), *then]
        program += _judge_argument(number, 0, permitted, _ERRNO | errno.EAFNOSUPPORT)
    return program


def open_filter() -> int:
    """Return a descriptor from which the filter can be read once; the caller closes it."""
    descriptor = os.memfd_create("seccomp")
    os.write(descriptor, filter_program())
    os.lseek(descriptor, 0, os.SEEK_SET)
    return descriptor


def step(code: int, operand: int = 0, if_true: int = 0, if_false: int = 0) -> bytes:
    """Return a step of a filter; what it jumps over is counted from the next one."""
    return _STEP.pack(code, if_true, if_false, operand)


def _answer_if(jump: int, operand: int, error: int) -> list[bytes]:
    return [step(jump, operand, 0, 1), step(_RETURN, _ERRNO | error)]


def _judge_argument(number: int, argument: int, tests: list[bytes], otherwise: int) -> list[bytes]:
    """Return steps for one system call: load an argument, test it, and answer; others pass by."""
    inner = [step(_LOAD, _ARGUMENTS + 8 * argument), *tests, step(_RETURN, otherwise)]
    return [step(_JUMP_EQUAL, number, 0, len(inner)), *inner]
