"""The ground's texture in street coordinates (s, t): read from the frames, rectified, sampled per pixel."""
