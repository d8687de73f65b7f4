"""Depth and force drive each other: the arm gives, the depth of cut changes, and with it the force.

With the tool s off where it is wanted, the force is W(s) and the arm gives s = C W(s): a loop of gain C dW/ds. Both the search for that
equilibrium and the mirror iteration t <- t + (t_0 - g(t)) contract where the spectral radius of the gain is below one (REFERENCE 3).
Once corrected, s = 0: the force is that of the stated depth again, and only what stands uncorrected has another.
This is about the mean force. Whether the cut chatters is a question of dynamics and out of scope.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.simulation import cartesian_compliance
from drake_stiffness.structure import Structure
from toolpaths.milling.along_path import MillingLoad

Floats = NDArray[np.float64]

_CHUNK = 4096


def depth_gain(structure: Structure, q: Floats, p_ET: Floats, load: MillingLoad) -> Floats:
    """Spectral radius (N,) of compliance times the change of the force with the tool's place.

    Parameters
    ----------
    structure : the arm with its springs
    q : (n, N)
    p_ET : (3,)
        The tool centre point in the flange, m.
    """
    out = np.zeros(q.shape[1])
    for start in range(0, out.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        compliance = cartesian_compliance(structure, q[:, part].T, p_ET)[:, :3]
        out[part] = np.abs(np.linalg.eigvals(compliance @ load.slopes(part))).max(axis=1)
    return out
