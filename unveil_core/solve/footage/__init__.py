"""Frames of clips and of folders of photographs: as they are decoded, with their times."""
