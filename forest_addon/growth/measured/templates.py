"""Trees from templates that are to measure something: what of it their settings can be asked for.

A sibling takes height and diameter, so that its fitted grammar grows a tree of that size; what is over, and
crown and leaves of all trees of template parts, ``reshape`` brings to the targets.
"""

from __future__ import annotations

from ...spec import Species
from .wanted import Wanted


def fitted_template(species: Species, wanted: Wanted) -> Species:
    """The species with settings that make its trees as tall and as thick as wanted."""
    if species.siblings is not None:
        sized = species.siblings.changed(age=1.0, height=wanted.height, dbh=wanted.dbh)
        return species.changed(siblings=sized)
    return species
