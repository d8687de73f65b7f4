"""The single-link example of the source paper (3.2)."""
