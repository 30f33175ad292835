"""The Triton backend, for NVIDIA GPUs; importing it needs ``triton``."""
