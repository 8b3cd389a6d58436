"""How long a process runs at a stretch on a busy core: short slices let it answer soon after it wakes.

Linux 6.12 and later take the length of a slice as a request (`sched_setattr`). A process with a shorter slice than the
one that runs goes first when it wakes, as long as it has not used more than its share. It needs no privilege, and the
share stays as it is. Earlier kernels ignore the request.
"""

import ctypes
import os
import platform
import struct
from contextlib import suppress

_SHORTEST_NS = 100_000  # the kernel takes none below
_SYSTEM_CALL = {
    "x86_64": 314,
    "aarch64": 274,
}  # sched_setattr, which has no function in C or Python
_ATTRIBUTES = struct.Struct("=IIQiIQQQII")  # struct sched_attr (sched_setattr(2)), 56 bytes


def request_short_slices() -> None:
    """Ask for the shortest slices, for this thread and all threads and processes that it starts from now on."""
    _request(_SHORTEST_NS)


def request_usual_slices() -> None:
    """Ask for the system's usual slices again, as a child of a process with short ones."""
    _request(0)


def _request(slice_ns: int) -> None:
    """Ask for slices of this length; 0: the usual one. Does nothing where the system does not have it."""
    number = _SYSTEM_CALL.get(platform.machine())
    if number is None or not hasattr(os, "sched_getscheduler"):
        return
    with suppress(OSError):
        if os.sched_getscheduler(0) != os.SCHED_OTHER:
            return  # a real-time policy, which a user has chosen
        niceness = os.getpriority(os.PRIO_PROCESS, 0)
        attributes = _ATTRIBUTES.pack(
            _ATTRIBUTES.size, os.SCHED_OTHER, 0, niceness, 0, slice_ns, 0, 0, 0, 0
        )
        ctypes.CDLL(None).syscall(number, 0, attributes, 0)
