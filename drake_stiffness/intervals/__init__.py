"""How far a value may lie, cones included."""
