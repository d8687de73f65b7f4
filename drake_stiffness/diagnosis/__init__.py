"""Where simulation and measurement disagree, what effect is missing, and whether adding it closes the gap."""
