"""The rasterizer on NVIDIA GPUs (Triton)."""
