"""Choices made from held-out blocks: iterations, surfels, sky resolution, colour degree."""
