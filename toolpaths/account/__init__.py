"""The honest account of a correction: what is predicted at every point, how sure it is, why the tool moves, what to look at."""
