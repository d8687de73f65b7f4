"""The conditions of restoration: cones of the model's springs and rules of its beams, on springs in units of usual sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drake_stiffness.effects.compliance import Spring
from drake_stiffness.model import Model
from drake_stiffness.restoration.beam_mechanics import LinkBeam
from drake_stiffness.rotations import Array

# Of the median size in a link, and of that of all springs: the least that counts as a usual size.
_SHARE = 0.03


@dataclass(frozen=True, eq=False)
class Rule:
    """One condition of the program: 'row @ y <= limit' or 'blocks @ y positive semidefinite'.

    Attributes
    ----------
    name : str
    link : str
        Empty for a cone of the model itself, which no section bound can be blamed for.
    row, limit, weight
        Of a linear rule, on springs in units of their usual sizes; the row is scaled to terms of size one.
    block : (k, k, n) or None
        Of a cone.
    """

    name: str
    link: str
    row: Array
    limit: float = 0.0
    weight: float = 1.0
    block: Array | None = None

    def inside(self, y: Array) -> bool:
        """Whether springs (in units of their usual sizes) are strictly inside."""
        if self.block is None:
            return float(self.row @ y) < self.limit
        return float(np.linalg.eigvalsh(self.block @ y)[0]) > 0.0


def program_rules(model: Model, beams: list[LinkBeam], springs: NDArray[np.int_], usual: Array) -> list[Rule]:
    """The cones of the model's springs and the rules of its beams.

    Parameters
    ----------
    springs : (n,)
        Numbers of the spring parameters in the model.
    usual : (n,)
        Their usual sizes, in units of scale.
    """
    n = springs.size
    place = {int(i): k for k, i in enumerate(springs)}
    rules: list[Rule] = []
    unit = np.diag(usual)
    for effect, own in zip(model.effects, model.slices, strict=True):
        if not isinstance(effect, Spring):
            continue
        for block in effect.cone_blocks:
            matrix = np.zeros((*block.shape, n))
            for where in zip(*np.nonzero(block >= 0), strict=True):
                matrix[where] = unit[place[own.start + int(block[where])]]
            if block.shape[0] == 1:
                rules.append(_linear(f"{effect.names[int(block[0, 0])]} >= 0", "", -matrix[0, 0]))
            else:
                rules.append(_cone(f"{effect.where} positive semidefinite", "", matrix))
    for beam in beams:
        at = [place[i] for i in range(beam.own.start, beam.own.stop)]
        entries = np.zeros((8, n))
        entries[:, at] = beam.entries * model.scales[beam.own] * usual[at]
        given = beam.rules
        for name, row, limit, weight in zip(
            given.names, given.rows @ entries, given.limits, given.weights, strict=True
        ):
            rules.append(_linear(f"{beam.link}: {name}", beam.link, row, limit, weight))
        for name, block in zip(given.block_names, given.blocks, strict=True):
            rules.append(_cone(f"{beam.link}: {name}", beam.link, np.einsum("ijk,kn->ijn", block, entries)))
    return rules


def _linear(name: str, link: str, row: Array, limit: float = 0.0, weight: float = 1.0) -> Rule:
    size = float(np.abs(row).sum())
    return Rule(name, link, row / size, limit / size, weight)


def _cone(name: str, link: str, block: Array) -> Rule:
    """The cone with its components scaled (a congruence), so that terms on the diagonal have size one."""
    scale = 1.0 / np.sqrt(np.abs(np.einsum("iin->in", block)).sum(axis=1))
    return Rule(name, link, np.zeros(block.shape[2]), block=block * np.outer(scale, scale)[..., None])


def usual_sizes(model: Model, springs: NDArray[np.int_], y: Array) -> Array:
    """Sizes that make a well-conditioned program: a spring's own value, but no less than a share of its effect's median.

    Parameters
    ----------
    springs : (n,)
    y : (n,)
        In units of scale.
    """
    size = np.abs(y)
    least = _SHARE * max(float(np.median(size)), 1e-12)
    found = np.zeros(model.x.size)
    found[springs] = size
    for effect, own in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Spring):
            found[own] = np.maximum(found[own], max(_SHARE * float(np.median(found[own])), least))
    return found[springs]
