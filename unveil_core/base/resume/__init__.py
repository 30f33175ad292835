"""What makes long work resumable: checkpoints, parts, and the digests that say whether a part still fits."""
