"""Textures for meshes: an atlas of charts, painted from posed pictures."""

from unveil_core.mesh.texture.atlas import Atlas, TexturedMesh, unwrap
from unveil_core.mesh.texture.paint import TextureView, paint

__all__ = ["Atlas", "TextureView", "TexturedMesh", "paint", "unwrap"]
