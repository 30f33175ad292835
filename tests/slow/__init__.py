"""Slow checks, for pytest: ``make quality``."""
