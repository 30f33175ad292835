"""Unveil: the empty street from a drive."""
__version__ = "0.1.0"
