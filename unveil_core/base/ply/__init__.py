"""PLY (Stanford's polygon file format): the vertices of any file are read, and files of vertices are written."""
