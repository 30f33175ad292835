"""Readers of drives on disk, one format a module; ``registry`` chooses among them."""
