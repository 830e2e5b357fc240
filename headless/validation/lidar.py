"""LiDAR against measured clouds: returns of a pulse, stems found from a tripod, and thin branches.

Three parts: a plot of conifers by drone and aircraft (``plots``), stems of measured plots from one tripod
scan (``stems``), and diameters of thin branches in a scan with and without errors (``twigs``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .comparison import Comparison
from .plots import compare_own, compare_plots
from .stems import compare_stems
from .twigs import compare_twigs

TITLE = "LiDAR"
SUMMARY = """\
Measured: one 27 x 26 m plot of conifers by drone (352 pulses/m²) and by aircraft (22 pulses/m²), from the R
package spanner (GPL-3); nine plots of pine in La Rioja, every tree by hand and as one terrestrial scan
found it, from FORTLS (GPL-3); volumes of two ashes by Demol et al. (2022). Simulated are stands of our
conifer with what is known of the plots; instruments, which are not stated with the data, are assumed as
typical.
"""
TERMS = """\
What is short: in both clouds our pulses have too few returns, by 14 points of single ones. A smaller leaf
or a wider footprint moves them the right way: our conifer's leaves stand for whole tufts and stop a pulse
that needles would split, and its crowns are cones where the measured plot's canopy is closed. Diameters of
our stems come out right where the measured list is 2 cm short: bark, lichens, lean, wind and the other
program's own fit are not in ours.

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
