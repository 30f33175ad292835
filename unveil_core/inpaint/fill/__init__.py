"""Fills the gaps of the ground's texture: running medians along s, quilting, transverse markings, stop lines, crossings."""
