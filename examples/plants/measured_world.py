"""An arm, its force sensor and its tracker, and what goes wrong with them: everything a campaign's readings come from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .beams import Array
from .course import Course
from .deformation import Deformation
from .mishaps import Bump, Mishap, WrongLoad, WrongPosture
from .segmented_arm import SegmentedArm
from .sensor_errors import SensorErrors
from .tracker_errors import TrackerErrors


@dataclass(frozen=True)
class MeasuredWorld:
    """The truth of a campaign.

    Attributes
    ----------
    arm
        With whatever physics is hidden in it.
    zero_offset
        (n,) true joint position less the commanded one, rad or m.
    reflector_offset
        (P, 3) of the reference points from their stated places, flange frame, m.
    """

    arm: SegmentedArm
    zero_offset: Array
    reflector_offset: Array
    sensor: SensorErrors = field(default_factory=SensorErrors)
    tracker: TrackerErrors = field(default_factory=TrackerErrors)
    mishaps: tuple[Mishap, ...] = ()

    @classmethod
    def of(cls, arm: SegmentedArm, points: int) -> MeasuredWorld:
        """A world where nothing is wrong."""
        return cls(arm, np.zeros(arm.chain.size), np.zeros((points, 3)))

    def with_arm(self, **changes: object) -> MeasuredWorld:
        """The same world with other fields of the arm."""
        return replace(self, arm=replace(self.arm, **changes))  # type: ignore[arg-type]

    def read(
        self,
        q: Array,
        stated: Array,
        course: Course,
        load_point: Array,
        points: Array,
        *,
        start: Deformation | None = None,
        tolerance: float = 1e-13,
    ) -> Array:
        """Noise-free readings (N, P, 3) of points (P, 3) at commanded q (N, n) under stated wrenches (N, 6), m.

        `start` and `tolerance` are those of `SegmentedArm.equilibrium`.
        """
        taken, acting = q + self.zero_offset, stated
        for mishap in self.mishaps:
            if isinstance(mishap, WrongPosture):
                taken = mishap.on_posture(taken, course)
            if isinstance(mishap, WrongLoad):
                acting = mishap.on_wrench(acting, course)
        acting = self.sensor.true_wrench(acting, self.arm.chain.flange(taken)[0])
        shape, _ = self.arm.equilibrium(taken, acting, load_point, course=course, start=start, tolerance=tolerance)
        seen = shape.p[:, None] + np.einsum("nij,pj->npi", shape.R, points + self.reflector_offset)
        readings = self.tracker.read(seen, course.time_s)
        for mishap in self.mishaps:
            if isinstance(mishap, Bump):
                readings = mishap.on_readings(readings, course)
        return readings
