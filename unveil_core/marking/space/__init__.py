"""The scene that is clicked into, as points; and those of an object."""
