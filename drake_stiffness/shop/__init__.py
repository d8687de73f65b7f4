"""A plan as the shop can use it: robot program, load sheet, order."""
