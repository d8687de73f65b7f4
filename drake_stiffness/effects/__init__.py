"""Everything that bends the arm or shifts a reading is an effect; see `effect.Effect` for the interface."""

from __future__ import annotations

from drake_stiffness.effects.catalogue import effect_kinds, make_effect, register
from drake_stiffness.effects.effect import Carried, Cases, Effect, Parameter, Reading

__all__ = ["Carried", "Cases", "Effect", "Parameter", "Reading", "effect_kinds", "make_effect", "register"]
