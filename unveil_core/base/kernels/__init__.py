"""What kernels share: the device that they work on, the compiler with its files on disk, and hashing."""
