"""Frames as they are delivered: at the size, lens and bit depth of the footage, from clean frames of working size."""
