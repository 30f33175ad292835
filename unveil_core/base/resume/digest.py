"""Digest of values: two that are equal have the same one, on every machine."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from unveil_core.base.disk.open_safely import open_file

if TYPE_CHECKING:
    import torch

__all__ = ["digest_of"]

CHUNK = 1 << 20


def digest_of(*values: object) -> str:
    """32 hexadecimal digits of numbers, text, arrays, tensors, dataclasses, and of sequences, sets and mappings of them.

    A path counts by the content of its file, and not at all where it is none: where things lie does not change what they are.

    Raises:
        TypeError: something else is among them, a function for example. Left out, it could change unseen.
    """
    digest = hashlib.blake2b(digest_size=16)
    _add(digest, values)
    return digest.hexdigest()


def _add(digest: Any, value: object) -> None:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str | bytes):
        _mark(digest, type(value).__name__, repr(value))
    elif _is_tensor(value):
        _add(digest, value.detach().cpu().numpy())
    elif isinstance(value, np.ndarray):
        _mark(digest, "array", value.dtype.str, str(value.shape))
        digest.update(np.ascontiguousarray(value).data if value.size else b"")
    elif isinstance(value, Path):
        _add_file(digest, value)
    elif is_dataclass(value):
        _mark(digest, type(value).__name__)
        _add(digest, {f.name: getattr(value, f.name) for f in fields(value) if f.init})
    elif isinstance(value, Mapping):
        _mark(digest, "mapping", str(len(value)))
        for key in sorted(value, key=repr):
            _add(digest, key)
            _add(digest, value[key])
    elif isinstance(value, Set):
        _add(digest, sorted(value, key=repr))
    elif isinstance(value, Sequence):
        _mark(digest, "sequence", str(len(value)))
        for k in range(len(value)):
            _add(digest, value[k])
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


def _is_tensor(value: object) -> TypeGuard[torch.Tensor]:
    """Whether a value is one of PyTorch's, which is not imported for the question."""
    return "torch" in sys.modules and isinstance(value, sys.modules["torch"].Tensor)


def _mark(digest: Any, *words: str) -> None:
    """Words, so that no others together give the same bytes."""
    for word in words:
        raw = word.encode()
        digest.update(len(raw).to_bytes(8, "little") + raw)


def _add_file(digest: Any, path: Path) -> None:
    if not path.is_file():
        _mark(digest, "no file")
        return
    _mark(digest, "file", str(path.stat().st_size))
    with open_file(path) as stream:
        while chunk := stream.read(CHUNK):
            digest.update(chunk)
