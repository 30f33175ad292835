"""What the page draws from the scene's surfels: splats to turn, the street from above, a flight along it."""
