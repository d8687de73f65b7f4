"""Every link of a rigid chain cut into beam elements: geometry, shares of mass, compliance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Array, tapered_parts
from .chain import RigidChain
from .truth import Truth


@dataclass(frozen=True)
class Segments:
    """The beam elements of L = n + 1 links, S to a link, in each link's beam frame D.

    D has its origin at the link's own joint frame B, x along the straight line from there to the link's end E, and y
    along the axis of B that follows (cyclically) the one nearest to x, made perpendicular to x.

    Attributes
    ----------
    beam_R
        (L, 3, 3): D in B.
    end_R
        (L, 3, 3): E in D.
    step
        (L,): length of one element, m.
    masses
        (L, S): kg.
    centers
        (L, S, 3): centre of mass of an element from the element's start, axes of D, m.
    parts
        (L, S, 4, 6, 6): compliance of an element's tip in D, split into `beams.PARTS`.
    """

    beam_R: Array
    end_R: Array
    step: Array
    masses: Array
    centers: Array
    parts: Array


def cut(chain: RigidChain, truth: Truth) -> Segments:
    """Cut all links of a chain into the beams that the truth states.

    A link's mass m is shared equally; element s of length l carries m / S at the middle of its length plus one offset
    common to the elements, which puts the centre of mass of the link where the rigid arm has it.

    Raises
    ------
    KeyError
        If the truth lacks a link.
    ValueError
        If a link has no length.
    """
    count, links = truth.segments, len(chain.link_names)
    beam_R, end_R = np.empty((links, 3, 3)), np.empty((links, 3, 3))
    centers, parts = np.empty((links, count, 3)), np.empty((links, count, 4, 6, 6))
    lengths = np.linalg.norm(chain.end_p, axis=1)
    for k, name in enumerate(chain.link_names):
        if lengths[k] == 0.0:
            raise ValueError(f"link {name!r} has no length between its own joint and the next: it cannot be a beam")
        link = truth.links[name]
        beam_R[k] = beam_frame(chain.end_p[k])
        end_R[k] = beam_R[k].T @ chain.end_R[k]
        parts[k] = tapered_parts(link.section, lengths[k], count, link.taper, shear=truth.shear)
        middle = np.array([0.5 * lengths[k] / count, 0.0, 0.0])
        offset = beam_R[k].T @ chain.centers[k] - np.array([0.5 * lengths[k], 0.0, 0.0])
        centers[k] = middle + offset
    masses = np.repeat(chain.masses[:, None] / count, count, axis=1)
    return Segments(beam_R, end_R, lengths / count, masses, centers, parts)


def beam_frame(line: Array) -> Array:
    """Rotation of the beam frame whose x lies along `line` (3,)."""
    x = line / np.linalg.norm(line)
    following = np.eye(3)[(int(np.argmax(np.abs(x))) + 1) % 3]
    y = following - (following @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])
