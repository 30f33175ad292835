"""inpaint."""
