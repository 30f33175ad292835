# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussians as the PLY that Unveil and other programs read. No bpy here.

All attributes are floats, by the names of the reference implementation of 3D Gaussian Splatting: importers know few types.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..gaussians import Gaussians

__all__ = ["splat_ply"]

LEAST_OPACITY = 1e-6
"""Nearer to 0 or 1 the logit has no use: it would be rounded to infinity."""


def splat_ply(gaussians: Gaussians, facts: Mapping[str, np.ndarray], comments: Sequence[str] = ()) -> bytes:
    """The file.

    Args:
        gaussians: N of them, in the coordinates of the file.
        facts: whole numbers (N,) by the name of their attribute; a label is asked for by readers, and 0 where none is given.
        comments: lines of the header.
    """
    count, further = len(gaussians), len(gaussians.harmonics)
    opacity = np.clip(gaussians.base[:, 3].astype(np.float64), LEAST_OPACITY, 1 - LEAST_OPACITY)
    columns: dict[str, np.ndarray | float] = {
        **{axis: gaussians.positions[:, i] for i, axis in enumerate("xyz")},
        **dict.fromkeys(("nx", "ny", "nz"), 0.0),
        **{f"f_dc_{i}": gaussians.base[:, i] for i in range(3)},
        **{f"f_rest_{i * further + k}": gaussians.harmonics[k, :, i] for i in range(3) for k in range(further)},
        "opacity": np.log(opacity / (1 - opacity)),
        **{f"scale_{i}": np.log(np.maximum(gaussians.scales[:, i], 1e-12)) for i in range(3)},
        **{f"rot_{i}": gaussians.rotations[:, i] for i in range(4)},
        "label": 0.0,
        **facts,
    }
    table = np.zeros(count, [(name, "<f4") for name in columns])
    for name, values in columns.items():
        table[name] = values
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    lines += [f"element vertex {count}", *(f"property float {name}" for name in columns), "end_header"]
    return "".join(f"{line}\n" for line in lines).encode("ascii", "replace") + table.tobytes()
