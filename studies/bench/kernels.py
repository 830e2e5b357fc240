"""The waits of all sensors in one table: rows of the other sections, with the library and by numpy.

What Embree alone takes for the same rays, before anything is made of them, is the limit of rays and pulses.
"""

from __future__ import annotations

from . import flight, lidar, reverb, sonar
from .rows import Rows

TITLE = "kernels: with the library and by numpy, and Embree alone"
WORDS = "Rows of the sections lidar, sonar, reverb and flight, as they have them.\n"
CHOSEN = (
    *(f"rays of a tripod, {count} x 200k, embree" for count in (1, 100)),
    *(f"Embree alone, rays of a tripod, {count} x 200k" for count in (1, 100)),
    *(f"scan of 10 x 200,000, {subrays} rays a pulse, into a file" for subrays in (1, 19)),
    *(f"ping of 5 trees, 30°, {kinds}" for kinds in ("paper", "piston", "exact, wood")),
    *("1,000 trunks of 0.25 m, 1e-04", "10,000 trunks of 0.05 to 0.3 m, 1e-04"),
    *(f"steps, {flyers} flyers of {rays} rays" for flyers, rays in ((1, 64), (64, 64), (1, 1024))),
    *(f"Embree alone, {f} flyers of {r} rays" for f, r in ((1, 64), (64, 64), (1, 1024))),
)
EVERY: Rows = lidar.ROWS | sonar.ROWS | reverb.ROWS | flight.ROWS
ROWS: Rows = {name: EVERY[name] for name in CHOSEN}
