"""What charts leave open, frame by frame: holes, keyframes, propagation in reversed time, new surfels."""
