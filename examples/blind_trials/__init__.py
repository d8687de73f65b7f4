"""Blind trials of `diagnose`: campaigns with hidden effects, what an oracle could know of them, and the score.

Put `examples/` on the import path. `run.py` runs trials, `score.py` makes the tables of docs/blind_trials.md.
"""
