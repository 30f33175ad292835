"""The parts of :mod:`unveil_core.drives.formats.safe_pickle`: what stands in, what is unpickled, what is made of it."""
