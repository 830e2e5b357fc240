"""Contract of the tolerance of a sum over trunks, in one place: for users, the audit and the tests.

A relative error ε, from 1e-2 to 1e-6, holds against the formula (``scattering``) in the L2 norm of

- the whole record,
- each octave from 20 Hz to 0.45 of the sampling rate that is less than 120 dB below the whole,
- each tenth of the record in which the sound of a trunk begins and that is less than 100 dB below the whole
  (90 dB at 1e-6),

for all trunks of 1 mm to 2 m, all air, grounds and losses that the settings take, and all sampling rates;
with losses on the paths (``model = "forest"``) it holds down to 1e-5, and 1e-6 was met within a factor of 10
in all sweeps: ask for 0, the direct sum, where that matters.
Octaves are those of the record with its end faded out over 40 ms, and its start before the first arrival
faded in: a record that ends at once sounds at all frequencies. The formula's sound before the first
arrival, of a band that ends smoothly and of losses without dispersion, is part of it. Finer than 1e-6, and
at 0, every trunk is summed at every frequency, which keeps 1e-9 of the whole; a tolerance between 0 and
1e-9 is refused (``spec/reverb``).
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from .bands import roll_off

FINEST = 1e-6  # of the fast sums
LOWEST = 20.0  # Hz
FAINTEST_OCTAVE, FAINTEST_TENTH = 1e-6, 1e-5  # of the whole, in amplitude
EXACT = 3e-11  # of the whole: what the exact sum is good for at any time
FADED = 0.04  # s of the record's end


def judged(
    found: np.ndarray, exact: np.ndarray, rate: float, tolerance: float, arrivals: np.ndarray
) -> dict[str, float]:
    """Relative errors of all that a tolerance promises, by what they are of.

    found, exact : (N,) samples at ``rate`` Hz. arrivals : (M,) seconds, when trunks are first heard.
    """
    gap, whole = found - exact, float(np.linalg.norm(exact))
    if whole == 0:
        return {"whole": float(np.linalg.norm(gap))}
    result = {"whole": float(np.linalg.norm(gap)) / whole}
    first = int(0.8 * float(arrivals.min()) * rate) if len(arrivals) else 0
    result |= _octaves(gap, exact, rate, tolerance, first)
    least = max(FAINTEST_TENTH, EXACT / max(tolerance, FINEST)) * whole
    for number, part in enumerate(np.array_split(np.arange(len(exact)), 10)):
        size = float(np.linalg.norm(exact[part]))
        begins = len(part) and ((arrivals * rate > part[0]) & (arrivals * rate < part[-1])).any()
        if begins and size > least:
            result[f"tenth {number + 1}"] = float(np.linalg.norm(gap[part])) / size
    return result


def _octaves(
    gap: np.ndarray, exact: np.ndarray, rate: float, tolerance: float, first: int
) -> dict[str, float]:
    """first : samples before anything is heard, over which the record fades in."""
    end = min(int(FADED * rate), len(exact))
    fade = np.ones(len(exact))
    fade[len(exact) - end :] = roll_off(0.45 + 0.05 * np.arange(end) / max(end, 1))
    start = min(first, int(FADED * rate), len(exact))
    fade[:start] *= roll_off(0.5 - 0.05 * np.arange(start) / max(start, 1))
    of_gap, of_exact = fft.rfft(gap * fade), fft.rfft(exact * fade)
    frequency = fft.rfftfreq(len(exact), 1.0 / rate)
    whole = float(np.linalg.norm(exact)) * np.sqrt(len(exact) / 2.0)  # as rfft has it
    least = max(FAINTEST_OCTAVE, EXACT / max(tolerance, FINEST)) * whole
    result, low = {}, LOWEST
    while low < 0.45 * rate:
        rows = (frequency >= low) & (frequency < min(2.0 * low, 0.45 * rate))
        size = float(np.linalg.norm(of_exact[rows]))
        if size > least:
            result[f"{low:g} Hz"] = float(np.linalg.norm(of_gap[rows])) / size
        low *= 2.0
    return result
