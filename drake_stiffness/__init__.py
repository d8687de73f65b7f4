"""Identify how an industrial arm bends under load, say what the measurements can show, and correct milling programs.

Heavy imports (Drake, cvxpy, matplotlib) happen inside the functions that need them, so that importing this package is
cheap and `predict` and `compensate` run where Drake has no wheels.
"""

from __future__ import annotations

__version__ = "0.6.0"
