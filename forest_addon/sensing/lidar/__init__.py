"""LiDAR: scanners, waveforms and point clouds; SIMLIDAR's tractor."""
