"""The two ways a job can end badly without being a fault of the program: exit codes 2 and 3 of the commands."""

from __future__ import annotations


class InputError(ValueError):
    """The input is wrong (exit code 2).

    The message says where (file, key path or line and column), what was found, what was expected with its unit, and
    how to mend it.
    """


class UntrustworthyError(RuntimeError):
    """The job ran, but its result must not be trusted or the program cannot be machined so (exit code 3)."""
