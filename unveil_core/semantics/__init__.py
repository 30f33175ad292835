"""Classes, label lifting, instances."""
