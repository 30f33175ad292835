"""The scene for splat viewers: 3DGS PLY, SPZ, glTF and USD."""
