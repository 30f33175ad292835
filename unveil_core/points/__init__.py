"""Points by optical flow between frames whose cameras are known."""
