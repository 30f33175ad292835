"""Readers of drives on disk, one format a module."""
