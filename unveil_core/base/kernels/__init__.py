"""What compiled kernels share: the compiler, with its files on disk, and hashing."""
