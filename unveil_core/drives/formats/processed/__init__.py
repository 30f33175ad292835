"""Layouts into which projects of street reconstruction bring the datasets."""
