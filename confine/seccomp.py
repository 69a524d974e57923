"""The system call filter of confined processes, as a classic BPF program for Linux on x86-64.

It denies calls that ordinary programs do not need and that have served to leave sandboxes: namespaces and mounts,
tracing, keys, io_uring, kernel modules and clocks, and socket families besides UNIX, INET, INET6 and NETLINK. It also
denies System V memory, semaphores and queues, which belong to no process and outlive all; the choice of cores, because
the caller may hold a process to one; and locks on files that other processes read.

References
----------
`man 2 seccomp`, `man 2 syscalls`; numbers from the kernel's `arch/x86/entry/syscalls/syscall_64.tbl`.
"""

from __future__ import annotations

import ctypes
import errno
import os
import struct
from collections.abc import Iterable

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
#: Arguments: of `prlimit64` for the calling process, and of `setpriority` for one process.
_OWN_PROCESS = _ONE_PROCESS = 0
#: The process id -1, as 32 bits.
_ALL_PROCESSES = 0xFFFFFFFF
#: AF_UNIX, AF_INET, AF_INET6, AF_NETLINK (`getifaddrs` needs the last).
_AF_UNIX, _AF_INET, _AF_INET6 = 1, 2, 10
_SOCKET_FAMILIES = (_AF_UNIX, _AF_INET, _AF_INET6, 16)
#: Bits of a socket's type that hold its kind; the rest are flags.
_SOCKET_KIND, _DATAGRAM = 0xF, 2
#: TIOCSTI and TIOCLINUX put characters into a terminal's input; FS_IOC_SETFLAGS, FS_IOC_FSSETXATTR and
#: FS_IOC_ENABLE_VERITY (for good) set attributes of a file that is open for reading.
_REQUESTS = (0x5412, 0x541C, 0x40086602, 0x401C5820, 0x40806685)
#: F_SETLEASE holds up each process that opens the file, for 45 s each time; F_NOTIFY is of the same kind. A lease needs
#: the owner of the file, as confined programs of an ordinary user are, and no file open for writing.
_FILE_COMMANDS = (1024, 1026)
#: SCHED_OTHER, also without its children (SCHED_RESET_ON_FORK): libraries such as Fast DDS set it for their own threads,
#: and a filter cannot tell ids of these from others.
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


#: Calls that change a file's rights, owner, times, attributes or length by its name, or by a descriptor for reading.
#: Landlock does not restrict these (the length since Linux 6.2), and the owner of a file may use them.
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

    Without `own_spaces` (process ids, a network, a read-only system) a signal to all processes is denied, and all
    sockets of a network but datagrams: Landlock knows neither TCP's relatives nor connecting by sending. Without
    `own_user` besides, AF_UNIX is denied, because services trust the user id of a caller, and so is changing that
    user's files.
    """
    denied = list(DENIED.values())
    if not own_user:
        denied += DENIED_TO_OWNERS.values()
    program = [
        step(_LOAD, _ARCHITECTURE),
        step(_JUMP_EQUAL, _AUDIT_ARCH_X86_64, 1, 0),
        step(_RETURN, _KILL_PROCESS),
        step(_LOAD, _NUMBER),
        *_answer_if(_JUMP_AT_LEAST, _X32_BIT, errno.ENOSYS),
    ]
    for number in sorted(denied):
        program += _answer_if(_JUMP_EQUAL, number, errno.EPERM)
    if not own_spaces:
        to_all = _answer_if(_JUMP_EQUAL, _ALL_PROCESSES, errno.EPERM)
        program += _judge_argument(_KILL, 0, to_all, _ALLOW)
    if not own_user:
        cuts = [step(_AND, _CUTS), *_answer_if(_JUMP_EQUAL, _CUTS_BY_READING, errno.EPERM)]
        program += _judge_argument(_OPEN, 1, cuts, _ALLOW)
        program += _judge_argument(_OPENAT, 2, cuts, _ALLOW)
    program += _of_others()
    # Flags of `clone3` lie in memory, out of a filter's sight; without it, libraries use `clone`.
    program += _answer_if(_JUMP_EQUAL, _CLONE3, errno.ENOSYS)
    new_spaces = _answer_if(_JUMP_ANY_BIT, _NAMESPACES, errno.EPERM)
    program += _judge_argument(_CLONE, 0, new_spaces, _ALLOW)
    program += _judge_argument(_IOCTL, 1, _refuse(_REQUESTS), _ALLOW)
    program += _judge_argument(_FCNTL, 1, _refuse(_FILE_COMMANDS), _ALLOW)
    program += _of_sockets(own_spaces=own_spaces, local=own_user)
    program.append(step(_RETURN, _ALLOW))
    return b"".join(program)


def _of_others() -> list[bytes]:
    """Deny changing limits and weights of others with the same user id, such as the caller's own processes."""
    own = [step(_JUMP_EQUAL, _OWN_PROCESS, 0, 1), step(_RETURN, _ALLOW)]
    one = [step(_JUMP_EQUAL, _ONE_PROCESS, 0, 1 + len(own)), step(_LOAD, _ARGUMENTS + 8), *own]
    usual: list[bytes] = []
    for way in _USUAL_SCHEDULING:
        usual += [step(_JUMP_EQUAL, way, 0, 1), step(_RETURN, _ALLOW)]
    return [
        *_judge_argument(_PRLIMIT, 0, own, _ERRNO | errno.EPERM),
        *_judge_argument(_SETPRIORITY, 0, one, _ERRNO | errno.EPERM),
        *_judge_argument(_SETSCHEDULER, 1, usual, _ERRNO | errno.EPERM),
    ]


def _of_sockets(*, own_spaces: bool, local: bool) -> list[bytes]:
    """Permit sockets of some families; AF_UNIX only in pairs unless `local`."""
    families = set(_SOCKET_FAMILIES)
    if not local:
        families.remove(_AF_UNIX)
    of_no_permitted = _ERRNO | errno.EAFNOSUPPORT
    single = _permit_families(sorted(families), own_spaces=own_spaces)
    pairs = _permit_families(_SOCKET_FAMILIES, own_spaces=own_spaces)
    return [
        *_judge_argument(_SOCKET, 0, single, of_no_permitted),
        *_judge_argument(_SOCKETPAIR, 0, pairs, of_no_permitted),
    ]


def _permit_families(families: Iterable[int], *, own_spaces: bool) -> list[bytes]:
    """Return tests of a socket's family; without `own_spaces`, network sockets may be datagrams only."""
    allow = [step(_RETURN, _ALLOW)]
    datagrams = [
        step(_LOAD, _ARGUMENTS + 8),
        step(_AND, _SOCKET_KIND),
        step(_JUMP_EQUAL, _DATAGRAM, 0, 1),
        step(_RETURN, _ALLOW),
        step(_RETURN, _ERRNO | errno.EACCES),
    ]
    tests: list[bytes] = []
    for family in families:
        then = allow
        if family in (_AF_INET, _AF_INET6) and not own_spaces:
            then = datagrams
        tests += [step(_JUMP_EQUAL, family, 0, len(then)), *then]
    return tests


def open_filter() -> int:
    """Return a descriptor from which the filter can be read once; the caller closes it."""
    descriptor = os.memfd_create("seccomp")
    os.write(descriptor, filter_program())
    os.lseek(descriptor, 0, os.SEEK_SET)
    return descriptor


def step(code: int, operand: int = 0, if_true: int = 0, if_false: int = 0) -> bytes:
    """Return a step of a filter; jumps are counted from the next step."""
    return _STEP.pack(code, if_true, if_false, operand)


def _refuse(values: Iterable[int]) -> list[bytes]:
    """Return tests that answer EPERM for some values of an argument."""
    tests: list[bytes] = []
    for value in values:
        tests += _answer_if(_JUMP_EQUAL, value, errno.EPERM)
    return tests


def _answer_if(jump: int, operand: int, error: int) -> list[bytes]:
    return [step(jump, operand, 0, 1), step(_RETURN, _ERRNO | error)]


def _judge_argument(number: int, argument: int, tests: list[bytes], otherwise: int) -> list[bytes]:
    """Return steps for one system call: load an argument, test it, and answer; others pass by."""
    inner = [step(_LOAD, _ARGUMENTS + 8 * argument), *tests, step(_RETURN, otherwise)]
    return [step(_JUMP_EQUAL, number, 0, len(inner)), *inner]
