"""The empty street back in the layout of the dataset that it came from."""
