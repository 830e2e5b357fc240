"""LiDAR against measured clouds: returns of a pulse, stems found from a tripod, and thin branches.

Three parts: a plot of conifers by drone and aircraft (``plots``), stems of measured plots from one tripod
scan (``stems``), and diameters of thin branches in a scan with and without errors (``twigs``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .comparison import Comparison
from .own_cloud import compare_own
from .plots import compare_plots
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

`python -m headless validate lidar CLOUD.laz --scene MY.toml` holds the clouds of a scene to one of your
own.
"""


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """All three parts; or a cloud of the user's own against a scene."""
    if arguments.file:
        return compare_own(arguments.file, arguments.scene, out)
    found = compare_plots(data / "clouds", out, arguments.seed)
    found += compare_stems(data / "rioja", out, arguments.seed)
    return [*found, *compare_twigs(out, arguments.seed)]
