"""Fewer triangles: quadric edge collapses, with the colours carried along.

Garland and Heckbert, *Surface simplification using quadric error metrics* (1997), in Forstmann's fast form, by the
library fast-simplification.
"""

from __future__ import annotations

import numpy as np

from unveil_core.base.errors import SettingsError
from unveil_core.mesh.mesh import Mesh

__all__ = ["FEWEST_TRIANGLES", "decimate"]

FEWEST_TRIANGLES = 4
"""Of a closed surface."""


def decimate(mesh: Mesh, triangles: int) -> Mesh:
    """The mesh with at most so many triangles; unchanged where it has no more than that.

    A new vertex takes the mean colour of the vertices that were drawn together in it, as a texture is averaged when it
    is made smaller: a single one of them would keep the grain and lose the paint. Open borders recede a little, the
    more the fewer triangles are left.

    Raises:
        SettingsError: fewer than 4, or fewer than the mesh's separate pieces can be brought to.
    """
    # Imported here, as trimesh is in export: most runs never ask.
    from fast_simplification import replay_simplification, simplify

    if triangles < FEWEST_TRIANGLES:
        raise SettingsError(f"{triangles} triangles make no surface", mend=f"ask for at least {FEWEST_TRIANGLES}")
    if len(mesh.faces) <= triangles:
        return mesh
    *_, collapses = simplify(mesh.vertices, mesh.faces, target_count=triangles, return_collapses=True)
    vertices, faces, merged = replay_simplification(mesh.vertices, mesh.faces, collapses)
    if len(faces) > triangles:
        raise SettingsError(
            f"the mesh cannot be brought to {triangles:,} triangles", mend=f"ask for at least {len(faces):,}"
        )
    used = merged >= 0  # vertices of no triangle belong nowhere
    merged, old = merged[used], mesh.colors[used]
    members = np.maximum(np.bincount(merged, minlength=len(vertices)), 1)
    colors = np.stack([np.bincount(merged, old[:, k], len(vertices)) / members for k in range(3)], axis=1)
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), np.round(colors).astype(np.uint8))
