"""Reads robot programs, finds postures along them, and pre-deforms them with an identified stiffness model."""
