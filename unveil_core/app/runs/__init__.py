"""Whole runs as the command begins them: with what settings, and planned only where it is asked."""
