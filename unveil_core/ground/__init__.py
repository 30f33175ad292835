"""The street's path and the ground: fitted once, read by every stage that asks where the street lies."""
