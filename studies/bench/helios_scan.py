"""A scan by PyHelios3D, in a process of its own: run by file, with the Python that has it.

An .npz with vertices (V, 3), triangles (T, 3), origin (3,) and the counts of zenith angles and azimuths goes
in; points (P, 3) go into a second one, and CPU seconds are printed: of the set-up and first scan, and of a
later scan.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from pyhelios import Context, LiDARCloud

job = np.load(sys.argv[1])
zeniths, azimuths = job["counts"].tolist()
start = time.process_time()
with Context() as context:
    context.addTrianglesFromArrays(job["vertices"].astype(np.float32), job["triangles"])
    with LiDARCloud() as cloud:
        cloud.disableMessages()
        cloud.disableCDGPUAcceleration()
        cloud.addScan(
            origin=job["origin"].tolist(),
            Ntheta=zeniths,
            theta_range=(0.0, 2.0),
            Nphi=azimuths,
            phi_range=(0.0, 2 * np.pi),
            exit_diameter=0.0,
            beam_divergence=0.0,
        )
        cloud.syntheticScan(context, record_misses=False)
        first = time.process_time() - start
        start = time.process_time()
        cloud.syntheticScan(context, record_misses=False)
        again = time.process_time() - start
        points = np.array(cloud.getHitsXYZRGBArrays()[0])
np.savez(sys.argv[2], points=points.reshape(-1, 3))
print(first, again)
