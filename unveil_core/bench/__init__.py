"""Measurements behind ``unveil bench``: speed against error."""
