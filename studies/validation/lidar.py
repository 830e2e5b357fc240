"""Gaps between the returns of a pulse from a tripod among conifers, beside those of a real VZ-400i scan.

The real scan (975,000 pulses; its stand is not described) had the quantiles in ``REAL`` and the shares in
``SHARES``. Ours is the pine plot of ``living``, by the instrument's own file, between 4 and 30 m.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from forest_addon.api import Rays, Terrestrial

from ..inside import make_caster, scan, settings_of, structure
from .flights import compare_flights, shares_of
from .own_cloud import compare_own
from .plots import geometry_of, pine_stems, site_of
from .run import Comparison, Interval
from .stems import compare_stems, compare_twigs
from .tapes import compare_diameters, compare_residuals
from .twin import compare_twin
from .waveforms import compare_waveforms

REAL = {0.001: 0.36, 0.01: 0.54, 0.05: 0.76, 0.1: 0.87}  # metres
SHARES = (92.8, 7.04, 0.15)  # %
NEAR_GAP = 0.1  # m that count as the same, stated before the run
RANGES = (4.0, 30.0)
STEP = 0.25  # degrees


def compare_gaps(seed: int) -> list[Comparison]:
    """Quantiles of the gaps between returns of a pulse, and what share of pulses has one."""
    site = site_of(pine_stems(seed), "scots-pine", seed)
    plain = structure(settings_of("riegl-vz-400i", "terrestrial", Path()), Terrestrial)
    scanner = plain.changed(position=(5.0, 5.0, 1.6), angle_step_deg=STEP)
    cloud = scan(scanner, make_caster(geometry_of(site, site.grow()), Rays()), seed)
    near, far = RANGES
    same = (np.diff(cloud.pulse) == 0) & (cloud.true_range[:-1] > near)
    gap = np.diff(cloud.returns.distance)[same & (cloud.true_range[1:] < far)]
    first = cloud.number == 1
    shares = 100 * shares_of(cloud.count[first])
    words = (
        f"Of {len(gap):,} gaps in {first.sum():,} pulses; pulses with 1, 2 and 3 returns "
        f"{shares[0]:.1f}, {shares[1]:.2f}, {shares[2]:.2f} %, in the real scan "
        f"{SHARES[0]}, {SHARES[1]}, {SHARES[2]}. Within 0.1 m; another stand."
    )
    return [
        Comparison(
            f"VZ-400i, gap between returns of a pulse, {100 * share:g} % are smaller",
            "m",
            Interval(real),
            Interval(float(np.quantile(gap, share))),
            bool(abs(float(np.quantile(gap, share)) - real) <= NEAR_GAP),
            words="" if k else words,
        )
        for k, (share, real) in enumerate(REAL.items())
    ]


# LiDAR against measured clouds: returns of a pulse, stems found from a tripod, and thin branches.
#
# Parts: a plot of conifers by drone and aircraft, line by line (``clouds.flights``), gaps between returns
# (``clouds.gaps``), stems of measured plots from one tripod scan (``stems``), their diameters beside
# those by hand (``tapes``), and of thin branches in a scan with and without errors (``twigs``).


TITLE = "LiDAR"
SUMMARY = """\
Measured: one 27 x 26 m plot of conifers by drone (352 pulses/m²) and by aircraft (22 pulses/m²), from the R
package spanner (GPL-3); 16 plots of pine in La Rioja, every tree by hand and as one terrestrial scan found
it, from FORTLS (GPL-3); volumes of two ashes by Demol et al. (2022); one plot of 50 x 50 m in the French Alps
with every tree and its airborne cloud, from lidaRtRee (GPL-3); 500 waveforms of an airborne digitiser over
Harvard Forest, from NEON by way of waveformlidar (Zhou et al. 2017, GPL-3). Simulated are stands with what is
known of the plots (trees as the clouds tell them; stems in the places, diameters and heights of four of
the 16); beams, which are not stated with the data, are assumed as typical.
"""
TERMS = """\
**Lines of the drone and the aircraft.** Heights, crowns and leaf area of the plot's trees, reflectances
and the threshold are read from the clouds, never from shares of returns. Ours is the mean of four stands
of the same trees, which differ by their seeds, with the lowest and the highest of them; a line agrees
whose mean is within 5 points. The slanted lines' file lacks the ground, so only pulses that meet a plant
first are compared there.

The files name neither species nor instrument. They lie on the Mogollon Rim of Arizona (470.6 and 3,810.2
km of UTM zone 12N, 2,280 m), where ponderosa pine is the common tree, and are of 19 and 22 September
2020. The drone's scanner sends some 0.75 M pulses and 83 lines a second and sees beyond 60 degrees to
both sides.

Four things limit what these rows can say:

- **Leaf area.** To hold back as much light as the aircraft's cloud shows, the stand has to bear 15 to 18
  m² of leaves a square metre; evenly spread shoots would need 4.9, and no pine stand is known to bear so
  much. Our shoots of ponderosa pine shade their own needles too much: Law et al. (2001, Agric. For.
  Meteorol. 108, 1) measured 4 STAR of 0.8, which our shoot has with 105 needles in place of 435. With 105
  needles the stand bears 7.7 m², but pulses of the drone are split too often.
- **Pulses.** 5 % of the gaps between two returns from crowns are below 1.10 m in the drone's line at 26
  degrees and 1.13 to 1.18 m in the aircraft's; with the pulses of 3 and 4 ns that are assumed ours are
  below 0.63 and 0.75 m. Pulses of 6.1 and 6.5 ns give the gaps as measured and bring the aircraft's lines
  within 5 to 10 points, but move the drone's out of agreement.
- **The aircraft's instrument.** The drone's pulses, put together to beams of 0.4 m, see the real trees as
  the aircraft should: at a threshold of 9 % of a whole echo 26, 38, 26 and 9 % of pulses have 1, 2, 3 and
  4 returns, at 13 % 33, 48, 17 and 2. The aircraft has 42, 32, 19 and 6. Put together with pulses of 7 ns
  they give 41, 35, 19 and 5: so the receiver is the most likely reason why the aircraft's lines do not
  agree.
- **Crowns.** Crowns of ponderosa pine as published (Hann & Hanus 2001) and a second storey, as the clouds
  show it, bring the drone's lines nearer and the aircraft's farther away. Finer shoots (60 blades in
  place of 18) change the drone's lines by 4 to 5 points and no verdict; angles of branches and the
  threshold change less than stands differ by.

What is left has two signs: the drone's small beams are split more often in real crowns than in ours, the
aircraft's wide ones less often. Both ask for foliage that is finer within a tuft, and tufts that stand
farther apart; no measurement of either was found.

**Diameters of one scan.** Lists of La Rioja differ from the hand by 13 plots' means of -3.4 to -0.8 cm,
and neither a plot nor the scale of a scan is the cause. FORTLS's own algorithm on our boles with bark
makes 0.5 of the 2.2 cm: a tape spans furrows and reads 0.8 cm more than the area, a mean of distances
leaves part of them out, and sparse cells, with limbs in them, are dropped. Not explained are 1.7 cm, and
a spread of 4.7 cm in place of 1.4: 29 % of their stems are partly hidden, none of ours. Nearness and the
years between both measurements are left.

**Residuals of circles** are of slices of 30 cm from several tripods. Without an error of joining ours are
4.4 mm in the mean; stations that are joined amiss by 5, 8 and 12 mm along each axis make 5.2, 6.0 and 7.0
mm, so that the 8.2 mm of a joined plot ask for some 15 mm. A measured pine (TreeLS) is less round than
ours: its sectors of 10 degrees vary by 3.6 to 4.9 mm, ours by 2.5 to 3.2.

**Chablais 3** is what `lidar --like` writes from the cloud and its table, flown as it was, with the light
of the instrument that made it, a RIEGL LMS-Q560. Rows agree within 5 points, 0.5 m, or 0.2 of the
overlap; they are of two seeds, the command flies four. Trees of other species than spruce, fir and beech
stand as beeches; trees below 7.5 cm are in no table. Of the cloud itself only the receiver's threshold is
read, 0.17 at 1,500 m: with 0.20 the faintest fiftieth of our first of many echoes are 7, 14, 25 and 30 %
of the ground's at 500, 740 and twice 1,000 m, where the cloud's are 6, 16, 18 and 23 %. Echoes are parted
somewhat better than there (5 % of gaps are below 0.73 m, in the real cloud 0.88).

The twin's cover (seed 1) depends on

- **variants, 10 points.** With six a species, each in the size of its trees' diameters, beeches have crowns
  of 0.29 m² a square metre where their targets say 0.45, heights are up to 3 m amiss, and cover is 61 %;
  with each tree grown for itself it is 71 %. A species of a twin has up to twenty variants.
- **widths of crowns and their neighbours, 3 points.** Widths of beeches are those of 385 deciduous
  broadleaves ([trees as they are measured](measured-trees.md#allometry)), not of 1,096 of which 1,070 are
  evergreens of the tropics, and neighbours narrow crowns where these stand, aside of their stems. Circles
  of the targets cover 83 % of the plot; 80 if narrowed by distances of stems, 79 with the widths of the
  tropics as well.
- **pulses without an echo, 2 points.** Steps of the mirror without a return tell how many were lost: of
  pulses between two that met the canopy 10 and 14 % at 1,000 m, 1 % and less at 740 and 500 m. With a
  threshold of 0.20 ours lose a quarter at 1,000 m, and cover is 62 and 68 % there, 77 at 740 and 80 at
  500 m (real 80, 84, 84, 86). With 0.17 it is 76 % in all (74), but 43 % of pulses have one return (47).

The ground does not agree: of a hundred pulses at 500 m 34 meet the canopy and the ground, in the real cloud
11. Near stems both agree (12 and 11 % of last returns at the ground within half a metre), from 1.5 to 2 m
away 42 and 15 %. A beech alone hides 99 % of the ground to three quarters of its radius, and 62 % of what
is beyond, where 44 % of its circle is; evenly strewn leaves (`gaps` 0) or a crown of leaves at its surface
(`shell` 1) make it 68 and 69, and no measurement of either was found. Understorey is not what is missing:
from 3 to 4 m off any stem the real canopy above 6 m covers 55 % of the ground, ours 43, what is lower 11
and 5 %.

**Waveforms.** The 500 lie on one transect of 60 x 3 m, so ours are transects of that size. Echoes of the
digitiser are never as narrow as what it sends: Gaussians fitted to sent pulses have a standard deviation
of 6.9 ns, to the narrowest twentieth of single echoes 8.3 ns and less. The scanner `optech-gemini`
therefore has the mean of the 25 narrowest for its pulse; nothing else is from these data. Echoes are as
many and as wide as measured. The light as a whole does not agree: of real pulses with several echoes nine
in ten end within 10 m of the first, two in three of ours see the ground through gaps. Light passes
between our crowns' tufts, not through them, as at Chablais 3. Leaves that pass 45 % of the light, as at
1064 nm, make it no better.

**A VZ-400i's gaps** between returns agree without a dead zone: the length of the pulse alone makes that
edge. Shares of returns are not judged, as the stand of the real scan is not described. They depend on the
threshold: without one, 7, 19, 61 and 300 sub-rays give 88.3, 85.7, 83.4 and 81.0 % single returns (real
92.8); with 4 % of a white surface that fills the beam, and pulses of 3.6 ns, 61 sub-rays have 92.6, 7.1
and 0.3 % of 1, 2 and 3 returns (92.8, 7.04, 0.15). From 1 % on 19 sub-rays are enough ([how
many](lidar.md#one-pulse)).

`python -m studies validate lidar CLOUD.laz --scene MY.toml` compares the clouds of a scene with one of
your own.

### Two clouds compared

`python -m studies validate lidar A.laz B.laz` compares two clouds, real or simulated, by measures
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
        return compare_own(arguments.file, arguments.scene)
    found = compare_flights(data / "clouds", arguments.seed)
    found += compare_twin(data, out, arguments.seed)
    found += compare_waveforms(data / "waveforms", arguments.seed)
    found += compare_gaps(arguments.seed)
    found += compare_stems(data / "rioja", out, arguments.seed)
    found += compare_diameters(data / "rioja", arguments.seed)
    found.append(compare_residuals(data / "wood", arguments.seed))
    return [*found, *compare_twigs(out, arguments.seed)]
