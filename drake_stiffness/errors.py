"""The two ways a job can end badly without being a fault of the program: exit codes 2 and 3 of the commands."""

from __future__ import annotations


class InputError(ValueError):
    """The input is wrong (exit code 2).

    The message says where (file, key path or line and column), what was found, what was expected with its unit, and
    how to mend it.
    """


class UntrustworthyError(RuntimeError):
    """The job ran, but its result must not be trusted or the program cannot be machined so (exit code 3)."""


class NoEquilibriumError(UntrustworthyError):
    """A load that the arm cannot carry, or whose equilibrium is not found.

    Parameters
    ----------
    case : int
        Which of the cases, from 0.
    what : str
        Posture, load and reason.
    """

    def __init__(self, case: int, what: str) -> None:
        super().__init__(f"case {case + 1}, {what}")
        self.case, self.what = case, what
