"""Camera poses refined against the photographs: features, tracks, and their bundle adjustment."""
