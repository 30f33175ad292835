"""Measurements: milliseconds against error, side by side with others, in one run."""
