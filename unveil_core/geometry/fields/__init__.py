"""Smooth quantities over a picture."""
