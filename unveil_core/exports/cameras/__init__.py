"""The cameras for other programs: nerfstudio, COLMAP, Nuke."""
