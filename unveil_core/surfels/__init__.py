"""The scene: semantic 2D Gaussian surfels and the sky."""
