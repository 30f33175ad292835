"""Streets by seed: each number draws another street, photographed twice, crowded and empty."""
