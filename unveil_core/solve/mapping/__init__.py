"""Cameras by pycolmap, in a process of its own, and those of frames that it was not asked for."""
