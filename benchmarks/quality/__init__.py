"""Slow checks of quality, for pytest: ``make quality``."""
