"""A lock on an open file, which ends with the process that holds it: however that ends."""

from __future__ import annotations

import errno
import sys

# At once: a program that gave up its rights may not load it any more.
if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

__all__ = ["TAKEN", "lock_file"]

TAKEN = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)
"""What the system says where somebody else holds the lock; anything else means that the file system has no locks."""


def lock_file(handle: int, shared: bool = False) -> None:
    """Lock the file, or say at once that it is taken.

    Args:
        handle: of the open file.
        shared: beside others that lock it shared. Windows has no such lock: there they exclude each other.

    Raises:
        OSError: with a number of ``TAKEN`` where another process holds it, else the file system's refusal.
    """
    if sys.platform == "win32":
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    else:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
