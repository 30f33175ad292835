"""When and in which order the frames of a drive were taken, and by how many cameras: what its files leave open or get wrong."""
