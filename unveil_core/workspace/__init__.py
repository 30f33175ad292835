"""A workspace folder: its files, lock and journal."""
