"""Labels of photographs that have none: from boxes and points of the dataset, or from a network."""
