"""Where the sun stands and what it lights: shadow map, shade on the ground, relighting of removed shadows."""
