"""The steps of a solve: each reads what those before left in the drive's folder, and leaves its own."""
