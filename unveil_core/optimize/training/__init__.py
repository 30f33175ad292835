"""One training step: parameters, losses, Adam, density control, schedule."""
