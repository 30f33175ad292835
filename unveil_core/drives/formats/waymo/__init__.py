"""Waymo Open Dataset, perception, version 2: ``reading`` opens a segment, the other modules know its tables."""
