"""All runs of a job: which one comes, which share of the whole it is, what was estimated and what it took."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..shell.progress import duration
from ..shell.words import say

if TYPE_CHECKING:
    from ...sensing.kind import Cost


def time_in_words(seconds: float) -> str:
    """A time that was taken or estimated: exact to a tenth of a second where that says something."""
    return f"{seconds:.1f} s" if seconds < 9.95 else duration(seconds)


class Ahead:
    """All runs of a job, one after the other: which one comes, and which share of the whole it is."""

    def __init__(self, of_sensors: list[Cost], frames: int) -> None:
        self._of_sensors, self._frames, self._done = of_sensors, frames, 0
        self._times: dict[str, tuple[float, float]] = {}  # s taken and estimated, by sensor
        self._frame = sum(max(cost.seconds, 1e-3) for cost in of_sensors)

    def next(self, name: str) -> tuple[str, tuple[float, float], Cost]:
        """Return what the next run is called, from which share of the job to which it leads, what it
        costs."""
        frame, number = divmod(self._done, len(self._of_sensors))
        self._done += 1
        before = sum(max(cost.seconds, 1e-3) for cost in self._of_sensors[:number])
        cost = self._of_sensors[number]
        whole = self._frames * self._frame
        low = (frame * self._frame + before) / whole
        span = low, low + max(cost.seconds, 1e-3) / whole
        words = name
        if len(self._of_sensors) > 1:
            words = say(
                "{sensor}, {number} of {count}",
                sensor=words,
                number=number + 1,
                count=len(self._of_sensors),
            )
        if self._frames > 1:
            words = say(
                "{sensor}, frame {number} of {count}",
                sensor=words,
                number=frame + 1,
                count=self._frames,
            )
        return words, span, cost

    def note(self, name: str, took: float, estimated: float) -> None:
        """Note what a run took; those of a frame range add up."""
        before = self._times.get(name, (0.0, 0.0))
        self._times[name] = before[0] + took, before[1] + estimated

    def told(self, sentence: str) -> str:
        """Return what is said at the end: of one run its own sentence, of several the times of all."""

        def both(times: tuple[float, float]) -> str:
            took, estimated = map(time_in_words, times)
            return say("{took} ({estimated} estimated)", took=took, estimated=estimated)

        runs = list(self._times.items())
        if len(runs) == 1 and self._done == 1:
            estimated = time_in_words(runs[0][1][1])
            return say("{found} ({estimated} estimated)", found=sentence, estimated=estimated)
        whole = sum(times[0] for _, times in runs), sum(times[1] for _, times in runs)
        each = ", ".join(f"{name} {both(times)}" for name, times in runs)
        return say("{count} runs in {time}: {each}", count=self._done, time=both(whole), each=each)
