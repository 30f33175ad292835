"""The smallest input that still shows a finding, by leaving out what is not needed."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["shrunk"]

MOST_TRIES = 150


def shrunk(content: bytes, still: Callable[[bytes], bool]) -> bytes:
    """Leave out ever smaller pieces as long as ``still`` holds; at most :data:`MOST_TRIES` times."""
    tries, size = 0, max(len(content) // 2, 1)
    while tries < MOST_TRIES:
        at, smaller = 0, False
        while at < len(content) and tries < MOST_TRIES:
            without = content[:at] + content[at + size :]
            tries += 1
            if still(without):
                content, smaller = without, True
            else:
                at += size
        if size == 1 and not smaller:
            break
        size = max(size // 2, 1) if not smaller or size > len(content) else size
    return content
