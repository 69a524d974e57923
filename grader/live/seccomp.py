"""The system call filter of students' processes, as a classic BPF program for Linux on x86-64.

It denies what no ROS node needs and what has served to leave sandboxes: namespaces and mounts, tracing,
keys, io_uring, kernel modules and clocks, socket families beyond the four that DDS uses, memory that is no
process's, which nobody would count, and choosing cores, by which a process could leave the one that it is held to.

References
----------
`man 2 seccomp`, `man 2 syscalls`; numbers from the kernel's `arch/x86/entry/syscalls/syscall_64.tbl`.
"""

from __future__ import annotations

import errno
import os
import struct

_AUDIT_ARCH_X86_64 = 0xC000003E
_X32_BIT = 0x40000000

# Offsets in the kernel's `struct seccomp_data`; of an argument, its lower half.
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16

_LOAD, _JUMP_EQUAL, _JUMP_AT_LEAST, _JUMP_ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ALLOW, _KILL_PROCESS, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000

_SOCKET, _SOCKETPAIR, _IOCTL, _CLONE, _KILL, _CLONE3 = 41, 53, 16, 56, 62, 435
_SETPRIORITY, _PRLIMIT = 141, 302
#: What makes a call of the last two be about the caller's own process, or about one process at all.
_OWN_PROCESS = _ONE_PROCESS = 0
#: The process id -1, as 32 bits.
_ALL_PROCESSES = 0xFFFFFFFF
#: AF_UNIX, AF_INET, AF_INET6, AF_NETLINK (`getifaddrs` needs the last).
_AF_UNIX = 1
_SOCKET_FAMILIES = (_AF_UNIX, 2, 10, 16)
#: TIOCSTI and TIOCLINUX put characters into a terminal's input.
_TERMINAL_REQUESTS = (0x5412, 0x541C)
#: CLONE_NEWNS, NEWCGROUP, NEWUTS, NEWIPC, NEWUSER, NEWPID, NEWNET.
_NAMESPACES = 0x7E020000

#: System calls that answer EPERM.
DENIED = {
    "acct": 163, "add_key": 248, "adjtimex": 159, "bpf": 321, "chroot": 161, "clock_adjtime": 305,
    "clock_settime": 227, "delete_module": 176, "fanotify_init": 300, "finit_module": 313, "fsconfig": 431,
    "fsmount": 432, "fsopen": 430, "fspick": 433, "init_module": 175, "io_uring_enter": 426,
    "io_uring_register": 427, "io_uring_setup": 425, "ioperm": 173, "iopl": 172, "kcmp": 312,
    "kexec_file_load": 320, "kexec_load": 246, "keyctl": 250, "memfd_create": 319, "memfd_secret": 447,
    "modify_ldt": 154, "mount": 165, "mount_setattr": 442, "move_mount": 429, "name_to_handle_at": 303,
    "open_by_handle_at": 304, "open_tree": 428, "perf_event_open": 298, "pidfd_getfd": 438, "pivot_root": 155,
    "process_madvise": 440, "process_vm_readv": 310, "process_vm_writev": 311, "ptrace": 101, "quotactl": 179,
    "quotactl_fd": 443, "reboot": 169, "request_key": 249, "sched_setaffinity": 203, "setns": 308,
    "settimeofday": 164, "shmget": 29, "swapoff": 168, "swapon": 167, "syslog": 103, "umount2": 166,
    "unshare": 272, "userfaultfd": 323, "vhangup": 153,
}  # fmt: skip


def filter_program(*, spare_others: bool = False, local_sockets: bool = True) -> bytes:
    """Return the filter as an array of `struct sock_filter`, which bubblewrap and the kernel take.

    Parameters
    ----------
    spare_others : bool
        Whether to deny a signal to all processes, for where there are no process ids of one's own.
    local_sockets : bool
        Whether to permit sockets of the family AF_UNIX, by which services of the machine are reached that trust the
        user id, such as a container engine; pairs of them lead nowhere, and are always permitted.
    """
    program = [
        _step(_LOAD, _ARCHITECTURE),
        _step(_JUMP_EQUAL, _AUDIT_ARCH_X86_64, 1, 0),
        _step(_RETURN, _KILL_PROCESS),
        _step(_LOAD, _NUMBER),
        *_answer_if(_JUMP_AT_LEAST, _X32_BIT, errno.ENOSYS),
    ]
    for number in sorted(DENIED.values()):
        program += _answer_if(_JUMP_EQUAL, number, errno.EPERM)
    if spare_others:
        program += _judge_argument(_KILL, 0, _answer_if(_JUMP_EQUAL, _ALL_PROCESSES, errno.EPERM), _ALLOW)
    # Limits and weights of others with the same user id, which may be the grader's own processes.
    own = [_step(_JUMP_EQUAL, _OWN_PROCESS, 0, 1), _step(_RETURN, _ALLOW)]
    program += _judge_argument(_PRLIMIT, 0, own, _ERRNO | errno.EPERM)
    one = [_step(_JUMP_EQUAL, _ONE_PROCESS, 0, 1), _step(_RETURN, _ALLOW)]
    program += _judge_argument(_SETPRIORITY, 0, one, _ERRNO | errno.EPERM)
    # Its flags lie in memory, where no filter can look; without it, libraries use `clone`.
    program += _answer_if(_JUMP_EQUAL, _CLONE3, errno.ENOSYS)
    program += _judge_argument(_CLONE, 0, _answer_if(_JUMP_ANY_BIT, _NAMESPACES, errno.EPERM), _ALLOW)
    terminal = [step for r in _TERMINAL_REQUESTS for step in _answer_if(_JUMP_EQUAL, r, errno.EPERM)]
    program += _judge_argument(_IOCTL, 1, terminal, _ALLOW)
    for number in (_SOCKET, _SOCKETPAIR):
        families = [f for f in _SOCKET_FAMILIES if f != _AF_UNIX or local_sockets or number == _SOCKETPAIR]
        permitted = [step for f in families for step in (_step(_JUMP_EQUAL, f, 0, 1), _step(_RETURN, _ALLOW))]
        program += _judge_argument(number, 0, permitted, _ERRNO | errno.EAFNOSUPPORT)
    program.append(_step(_RETURN, _ALLOW))
    return b"".join(program)


def open_filter() -> int:
    """Return a descriptor from which the filter can be read once; the caller closes it."""
    descriptor = os.memfd_create("seccomp")
    os.write(descriptor, filter_program())
    os.lseek(descriptor, 0, os.SEEK_SET)
    return descriptor


def _step(code: int, operand: int, if_true: int = 0, if_false: int = 0) -> bytes:
    return struct.pack("=HBBI", code, if_true, if_false, operand)


def _answer_if(jump: int, operand: int, error: int) -> list[bytes]:
    return [_step(jump, operand, 0, 1), _step(_RETURN, _ERRNO | error)]


def _judge_argument(number: int, argument: int, tests: list[bytes], otherwise: int) -> list[bytes]:
    """Return steps for one system call: load an argument, test it, and answer; others pass by."""
    inner = [_step(_LOAD, _ARGUMENTS + 8 * argument), *tests, _step(_RETURN, otherwise)]
    return [_step(_JUMP_EQUAL, number, 0, len(inner)), *inner]
