"""The rasterizer on the processor (numba)."""
