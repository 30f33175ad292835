"""``unveil mask``: its options, and what it does."""
