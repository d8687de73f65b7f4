"""Models with fewer parameters, held against each other on held-out experiments."""
