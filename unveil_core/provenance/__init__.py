"""Where each pixel of the empty street comes from, and how sure it is."""
