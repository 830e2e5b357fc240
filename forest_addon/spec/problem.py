"""What cannot be used, in one sentence."""

from __future__ import annotations


class SpecError(ValueError):
    """A setting that cannot be used: ``key`` says where, the text says what and what to do."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(f"{key}: {problem}" if key else problem)
        self.key = key
        self.problem = problem

    def __reduce__(self) -> tuple[type[SpecError], tuple[str, str]]:
        return type(self), (self.key, self.problem)  # ValueError's own would lose the key
