"""Cameras and transforms; numpy and torch only."""
