"""A drive looked at before the wait: what it is, what is assumed of it and what looks wrong, as one page."""
