"""COLMAP models: their files, which of several is read, and the drive that is made of one."""
