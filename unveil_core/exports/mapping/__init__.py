"""The street for mapping and simulation: its points, and the objects that were taken out."""
