"""Many drives on many machines: a manifest of plain commands, and who runs them."""
