"""Classes, labels per frame and per point, visibility, objects."""
