"""The mesh of the empty street with textures."""
