"""Diameters of stems by hand and by scan: lists that are matched, tape and circle on bark."""
