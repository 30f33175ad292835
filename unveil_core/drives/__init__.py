"""Drives on disk and in memory."""
