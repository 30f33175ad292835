"""Pictures: what their headers say, and decoding them in one place."""
