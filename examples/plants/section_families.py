"""Links drawn at random from families of sections and materials: the truth that restored intervals are tried on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .sections import Cantilever, Section, box, i_section, moduli, solid, tube

Rng = np.random.Generator


def _length(rng: Rng) -> float:
    return float(rng.uniform(0.3, 1.2))


def _tapered(rng: Rng, material: str, tip: float) -> Cantilever:
    w, h, t = rng.uniform(0.12, 0.4), rng.uniform(0.12, 0.4), rng.uniform(0.006, 0.02)

    def section(share: float) -> Section:
        factor = 1.0 + (tip - 1.0) * share
        return box(w * factor, h * factor, t)

    return Cantilever(_length(rng), section, *moduli(material))


def prismatic_box(rng: Rng) -> Cantilever:
    """Steel tube of rectangular section, the same all along."""
    return _tapered(rng, "steel", 1.0)


def tapered_aluminium(rng: Rng) -> Cantilever:
    """Aluminium box that narrows to between 0.5 and 1 of its width."""
    return _tapered(rng, "aluminium", float(rng.uniform(0.5, 1.0)))


def tapered_iron(rng: Rng) -> Cantilever:
    """Grey cast iron box that narrows to between 0.5 and 1 of its width."""
    return _tapered(rng, "grey cast iron", float(rng.uniform(0.5, 1.0)))


def solid_steel(rng: Rng) -> Cantilever:
    """Solid steel bar, tapered."""
    w, h, tip = rng.uniform(0.06, 0.2), rng.uniform(0.06, 0.2), rng.uniform(0.5, 1.0)

    def section(share: float) -> Section:
        factor = 1.0 + (tip - 1.0) * share
        return solid(w * factor, h * factor)

    return Cantilever(_length(rng), section, *moduli("steel"))


def i_beam(rng: Rng) -> Cantilever:
    """Steel I-section, open, prismatic; warping is free."""
    w, h, f, t = rng.uniform(0.1, 0.2), rng.uniform(0.15, 0.35), rng.uniform(0.012, 0.025), rng.uniform(0.01, 0.02)
    return Cantilever(_length(rng), lambda share: i_section(w, h, f, t), *moduli("steel"))


def round_tube(rng: Rng) -> Cantilever:
    """Aluminium tube."""
    r, t = rng.uniform(0.05, 0.15), rng.uniform(0.005, 0.015)
    return Cantilever(_length(rng), lambda share: tube(r, t), *moduli("aluminium"))


def three_segments(rng: Rng) -> Cantilever:
    """Ductile iron: three pieces, each a box of its own width and height."""
    pieces = [box(rng.uniform(0.15, 0.35), rng.uniform(0.15, 0.35), rng.uniform(0.008, 0.02)) for _ in range(3)]
    ends = np.sort(rng.uniform(0.15, 0.85, 2))
    return Cantilever(
        _length(rng),
        lambda share: pieces[int(np.searchsorted(ends, share))],
        *moduli("ductile cast iron"),
        breaks=tuple(ends),
    )


def goose_neck(rng: Rng) -> Cantilever:
    """Slender ductile iron box whose centre line bulges sideways by 0.05 to 0.3 of its length: not straight."""
    w, h, t = rng.uniform(0.08, 0.14), rng.uniform(0.08, 0.14), rng.uniform(0.008, 0.015)
    length, about = float(rng.uniform(0.6, 1.2)), rng.uniform(0, 2 * np.pi)
    side = length * rng.uniform(0.05, 0.3) * np.array([np.cos(about), np.sin(about)])
    return Cantilever(
        length,
        lambda share: box(w, h, t),
        *moduli("ductile cast iron"),
        line=lambda share: np.sin(np.pi * share)[:, None] * side,
    )


def carbon_fibre(rng: Rng) -> Cantilever:
    """Box of fibres along the axis: E/G between 8 and 20."""
    straight = _tapered(rng, "aluminium", 1.0)
    E = 120e9
    return Cantilever(straight.length, straight.section, E, E / rng.uniform(8.0, 20.0))


#: Straight links of isotropic material.
SOUND: dict[str, Callable[[Rng], Cantilever]] = {
    "hollow box, steel": prismatic_box,
    "tapered box, aluminium": tapered_aluminium,
    "tapered box, grey cast iron": tapered_iron,
    "solid bar, steel": solid_steel,
    "I-section, steel": i_beam,
    "round tube, aluminium": round_tube,
    "three segments, ductile iron": three_segments,
}

#: Links that break an assumption of beam mechanics or of the default limits.
BROKEN: dict[str, Callable[[Rng], Cantilever]] = {
    "goose neck (not straight)": goose_neck,
    "carbon fibre (E/G 8 to 20)": carbon_fibre,
}
