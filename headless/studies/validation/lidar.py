"""LiDAR against measured clouds: returns of a pulse, stems found from a tripod, and thin branches.

Parts: a plot of conifers by drone and aircraft, line by line (``clouds.flights``), gaps between returns
(``clouds.gaps``), stems of measured plots from one tripod scan (``stems``), their diameters beside those by
hand (``diameters``), and of thin branches in a scan with and without errors (``twigs``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .clouds.flights import compare_flights
from .clouds.gaps import compare_gaps
from .comparison import Comparison
from .diameters import compare_diameters
from .own_cloud import compare_own
from .stems import compare_stems
from .twigs import compare_twigs

TITLE = "LiDAR"
SUMMARY = """\
Measured: one 27 x 26 m plot of conifers by drone (352 pulses/m²) and by aircraft (22 pulses/m²), from the R
package spanner (GPL-3); 16 plots of pine in La Rioja, every tree by hand and as one terrestrial scan found
it, from FORTLS (GPL-3); volumes of two ashes by Demol et al. (2022). Simulated are stands of our conifer
with what is known of the plots (stems in the places, diameters and heights of four of the 16); instruments,
which are not stated with the data, are assumed as typical.
"""
TERMS = """\
What is short: in both clouds our pulses have too few returns, by 14 to 15 points of single ones. For the
drone, leaves of half the length at the same leaf area take 7 points away and a footprint four times as wide
10; for the aircraft smaller leaves change nothing, so there it is more likely how foliage is spread: our
crowns are cones apart from each other, the measured plot's canopy is closed, with undergrowth. The
instruments are assumed, too. Diameters of our stems come out right where the measured list is 2 cm short;
bark, lean, wind and the other program's own fit are not in ours, and which of them it is was not found out.
A twig is thickened as measured in sign and place, but a tree by a tenth of what was measured: our tree has
less of its volume in twigs, and nothing of ours moves between scans.

The first rows mix angles: the drone's cloud has lines at 25 to 68 degrees off nadir, ours looked within 30.
Line by line, over pines with the foliage of the southwestern ponderosa pine (preset ponderosa-pine) in the
places of the plot's summits, a threshold read from the cloud makes the share of single returns rise with
the angle as measured only at 68 degrees; elsewhere ours have 11 to 27 points too few of them, for the drone
and the aircraft alike: light goes too deep into our crowns. By ablation, two of the drone's lines (26 and
56 degrees; measured 45 and 60 %): 34 and 35 % as they stand; 31 and 28 % with the threshold of the faintest
return of all in place of the faintest twentieth's, and from there 18 and 12 % with the shoots of Scots
pine, 32 and 32 % with leaves of 20 % reflectance in place of 35, 29 and 22 % with half the leaf area, 34
and 31 % with a pulse of 6 ns. So shoots and threshold matter most, the pulse and reflectances little, and
none is enough. Gaps between returns of a VZ-400i agree without a dead zone: the length of the pulse alone
makes that edge.

`python -m headless validate lidar CLOUD.laz --scene MY.toml` holds the clouds of a scene to one of your
own.

### Clouds held to clouds

`python -m headless validate lidar A.laz B.laz` holds two clouds to each other, real or simulated, by measures
that do not depend on how dense they are. Where the scanner was is read from the pulses themselves (first and
last return of a pulse lie on its beam), or told (`--origin X,Y,Z`). A distance agrees that is not above the
95th percentile of 40 random halvings of either cloud's blocks of 5 m; distances between flight lines of one
cloud stand beside it. The drone's cloud of the plot against the aircraft's:

| measure | drone | aircraft | distance | of halves | of lines | |
|---|---|---|---|---|---|---|
| light that passes a voxel of 1 m | 0.937 | 0.962 | 0.0267 | to 0.0259 | 0.00511 to 0.0436 | no |
| voxels of 1 m that 10 beams meet | 0.216 | 0.161 | 0.0623 | to 0.0862 | 0.02 to 0.0897 | agrees |
| profile of light, m, median | 22.2 | 22.4 | 0.0397 | to 0.181 | 0.0412 to 0.187 | agrees |
| light that reaches the ground | 0.176 | 0.324 | 0.29 | to 0.12 | 0.0649 to 0.206 | no |
| pulses by returns and angle, % single | 64.5 | 41.1 | 0.131 | to 0.0469 | 0.0372 to 0.0885 | no |
| ranges, m, median | 137 | 1.64e+03 | 1 | to 0.0936 | 0.447 to 1 | no |
| intensity over single ones' | 0.862 | 0.725 | 0.192 | to 0.0769 | 0.0325 to 0.183 | no |
| gaps between returns of a pulse, m, median | 3.22 | 4.21 | 0.133 | to 0.0988 | 0.0324 to 0.137 | no |

Stems are too few in points from above for circles. Two real clouds of one plot differ by more than their
halves do wherever angle, footprint or instrument come in: no simulation of one need come nearer to the other
than that.
"""


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """All parts; or a cloud of the user's own against a scene."""
    if arguments.file:
        return compare_own(arguments.file, arguments.scene, out)
    found = compare_flights(data / "clouds", arguments.seed)
    found += compare_gaps(arguments.seed)
    found += compare_stems(data / "rioja", out, arguments.seed)
    found += compare_diameters(data / "rioja", arguments.seed)
    return [*found, *compare_twigs(out, arguments.seed)]
