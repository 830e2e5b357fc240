"""Allometry: the size of a kind of tree over the diameter of its stem, as measured."""

from __future__ import annotations

from .base import Settings, SpecError, param

DBH = 0.2  # metres, the diameter that laws start from


class Law(Settings):
    """One measure over the diameter D at breast height.

    log y = intercept + slope·x + curve·x², x = log(D/0.2 m). Of the crown base y is the odds
    base/(height - base). ``low`` and ``high`` are the residuals that 5 % of the measured trees lie below
    and above; half of them lie below the law itself.
    """

    intercept: float = param(help="log y of a stem of 0.2 m", ge=-50, le=50)
    slope: float = param(help="how log y grows with log D", ge=-20, le=20)
    curve: float = param(0.0, help="how that slope changes, half a step of log D", ge=-20, le=20)
    low: float = param(help="residual of log y that 5 % lie below", ge=-10, le=-1e-3)
    high: float = param(help="residual of log y that 5 % lie above", ge=1e-3, le=10)
    dbh: tuple[float, float] = param(
        unit="m", help="smallest and largest diameter measured", gt=0, le=20
    )
    trees: int = param(help="how many trees were measured", ge=1, le=10**9)
    within: float = param(
        1.0, help="spread of residuals within one study, or stand, over that of all", gt=0, le=1
    )
    of: str = param("", help="whose trees, where they are not of the kind itself")

    def check(self) -> None:
        if self.dbh[0] >= self.dbh[1]:
            raise SpecError("dbh", f"{list(self.dbh)} must be [smallest, largest]")


class Allometry(Settings):
    """Height, crown and leaf area of one kind of tree over its diameter, and how they differ together."""

    name: str = param(help="name of the species or group")
    source: str = param("", help="where the trees were measured")
    height: Law = param(help="height, m")
    crown_width: Law = param(help="width of the crown, m")
    crown_base: Law = param(help="odds of the crown's base, base/(height - base)")
    leaf_area: Law = param(help="leaf area, half of the leaves' surface, m²")
    correlation: tuple[float, float, float, float, float, float] = param(
        help="of residuals: height and width, height and base, height and leaves, width and base, "
        "width and leaves, base and leaves",
        ge=-1,
        le=1,
    )
