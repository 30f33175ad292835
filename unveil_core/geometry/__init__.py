"""Cameras, transforms, and helpers on images and point sets that know nothing of streets."""
