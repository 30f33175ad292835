"""The scene: 2D Gaussians, the sky, their files, and the start from points."""
