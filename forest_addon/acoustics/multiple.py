"""Sound between trunks, exactly: multiple scattering by upright, endless, sound-hard cylinders.

Centres, radii, a line source and receivers in the plane go in, the pressure comes out, with every echo of
echoes (multipole expansions about each centre, coupled by Graf's addition theorem: Záviška 1913; Martin
2006, Multiple Scattering, 4.5). In the books' convention, e^{-iωt}, cylinder j sends out
Σ_n b_n·H_n(kr)e^{inθ}, and

    b_m(i) = T_m(i)·(c_m(i) + Σ_{j≠i} Σ_n H_{n-m}(k|d|)e^{i(n-m)arg d}·b_n(j)),   d = O_i - O_j

with T_m = -J_m'(ka)/H_m'(ka) and c of the source. H grows without bound with the order where J vanishes,
so the unknowns are y_n = -b_n/J_n'(ka), and every product is formed from logarithms: the matrix then has
entries below ((a_i + a_j)/|d|)^|n-m|, and no order overflows.

The source is H₀⁽¹⁾(kr), times a factor that makes it e^{-ikr}/√r far away under our e^{+iωt}: what reaches
a trunk falls with 1/√r, and what it sends on again, as cylinders alone do it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special
from scipy.linalg import solve
from scipy.sparse.linalg import gmres
from scipy.spatial import KDTree

from ..base.vectors import azimuth_of
from .cylinder import order_count

LARGEST = 8192  # unknowns; the matrix of so many takes 1 GB
DIRECT_UP_TO = 2500  # unknowns that are solved by elimination
CLOSE = 1e-10  # what the orders of near neighbours may leave out
MOST_ORDERS = 120
SPARE = 24  # orders above the last at which the downward recurrence starts
RESIDUAL = 1e-10


def scattered_field(
    frequency: np.ndarray,
    centre: np.ndarray,
    radius: np.ndarray,
    source: np.ndarray,
    receiver: np.ndarray,
    sound_speed: float,
    *,
    direct_up_to: int = DIRECT_UP_TO,
    orders: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Pressure that M cylinders add at R receivers, at F frequencies, under e^{+iωt}.

    frequency : (F,) Hz, above 0. centre : (M, 2), radius : (M,) metres.
    source : (2,) or (S, 2), receiver : (R, 2) metres. sound_speed : m/s.
    direct_up_to : unknowns up to which elimination is used, GMRES beyond.
    orders : the last one of each cylinder, for averages over stands; None: as many as the pressure needs.

    Returns
    -------
    (F, R), or (F, S, R), with multiple scattering; the same with each trunk as if it were alone.

    Raises
    ------
    ValueError : cylinders overlap or touch, one covers the source or a receiver, or there are more than
        ``LARGEST`` unknowns; says which.
    """
    receiver, sources = np.atleast_2d(receiver), np.atleast_2d(source)
    _check(centre, radius, sources, receiver)
    near = _nearness(centre, radius)
    every, once = [], []
    for wavenumber in 2.0 * math.pi * np.asarray(frequency, np.float64) / sound_speed:
        system = _System(wavenumber, centre, radius, near, orders)
        alone = np.stack([system.heard_from(one) for one in sources], axis=1)  # (U, S)
        heard = system.heard_at(receiver)
        coupled = system.coupled(alone, direct_up_to)
        far = math.sqrt(0.5 * math.pi * wavenumber) * np.exp(-0.25j * math.pi)
        every.append(far * np.conj(heard @ coupled).T)
        once.append(far * np.conj(heard @ alone).T)
    shape = (len(every), *np.shape(source)[:-1], len(receiver))
    return np.array(every).reshape(shape), np.array(once).reshape(shape)


def unknowns(frequency: float, centre: np.ndarray, radius: np.ndarray, sound_speed: float) -> int:
    """Size of the system that ``scattered_field`` solves at a frequency."""
    ka = 2.0 * math.pi * frequency / sound_speed * radius
    return int((2 * _last_orders(ka, _nearness(centre, radius)) + 1).sum())


class _System:
    """One wavenumber: U outgoing waves of M cylinders, each of an order n, in the scaled unknowns y."""

    def __init__(
        self,
        wavenumber: float,
        centre: np.ndarray,
        radius: np.ndarray,
        near: np.ndarray,
        orders: int | None = None,
    ) -> None:
        self.wavenumber, self.centre = wavenumber, centre
        last = _last_orders(wavenumber * radius, near)
        if orders is not None:
            last = np.minimum(last, orders)
        if (2 * last + 1).sum() > LARGEST:
            raise ValueError(
                f"{len(radius)} trunks of up to {2 * last.max() + 1} orders are more than {LARGEST} "
                "unknowns; take fewer trunks or a lower frequency"
            )
        self.owner = np.repeat(np.arange(len(radius)), 2 * last + 1)  # (U,)
        self.order = np.concatenate([np.arange(-n, n + 1) for n in [*last.tolist(), -1]])  # (U,)
        self.last = int(last.max(initial=0))
        ka, row = np.unique(wavenumber * radius, return_inverse=True)
        each = np.abs(self.order), row[self.owner]
        sign = _log_sign(self.order)
        self.outgoing = _log_hankel_slopes(ka, self.last)[each] + sign if len(ka) else sign
        self.regular = _log_bessel_slopes(ka, self.last)[each] + sign if len(ka) else sign

    def heard_from(self, source: np.ndarray) -> np.ndarray:
        """(U,) y if each cylinder were alone with a line source H₀."""
        waves = self._waves(self.centre - source, self.last)
        return np.exp(waves[self.owner, self.last - self.order] - self.outgoing)

    def heard_at(self, receiver: np.ndarray) -> np.ndarray:
        """(R, U) what each y adds to the pressure at the receivers."""
        waves = self._waves(receiver[:, None] - self.centre, self.last)
        return -np.exp(waves[:, self.owner, self.last + self.order] + self.regular)

    def coupled(self, alone: np.ndarray, direct_up_to: int) -> np.ndarray:
        """(U, S) y with every echo between the cylinders, of those without."""
        if len(self.centre) < 2:
            return alone
        matrix = self._coupling()
        if len(matrix) > direct_up_to:
            solved = [gmres(matrix, one, rtol=RESIDUAL, restart=100, maxiter=20) for one in alone.T]
            if not any(failed for _, failed in solved):
                return np.stack([coupled for coupled, _ in solved], axis=1)
        return solve(matrix, alone, overwrite_a=True, check_finite=False)

    def _coupling(self) -> np.ndarray:
        """(U, U) 1 + what the waves of the columns do to those of the rows."""
        matrix = np.eye(len(self.owner), dtype=np.complex128)
        for i in range(len(self.centre)):
            away = self.centre[i] - self.centre
            away[i] = 1.0  # itself: not used
            waves = self._waves(away, 2 * self.last)
            rows, others = np.flatnonzero(self.owner == i), np.flatnonzero(self.owner != i)
            step = self.order[others] - self.order[rows][:, None] + 2 * self.last  # n - m
            coupling = waves[self.owner[others], step] + self.regular[others]
            matrix[np.ix_(rows, others)] = np.exp(coupling - self.outgoing[rows][:, None])
        return matrix

    def _waves(self, away: np.ndarray, last: int) -> np.ndarray:
        """(..., 2·last + 1) log of H_l(kr)e^{ilθ} of vectors (..., 2), l from -last to last."""
        order = np.arange(-last, last + 1)
        distance = self.wavenumber * np.hypot(away[..., 0], away[..., 1])
        turn = azimuth_of(away)
        size = _log_hankel(distance.ravel(), last)[np.abs(order)]
        size = size.T.reshape(*distance.shape, len(order))
        return size + _log_sign(order) + 1j * order * turn[..., None]


def _log_sign(order: np.ndarray) -> np.ndarray:
    """Logarithm of (-1)^n for n below 0, of 1 above: C_{-n} = (-1)^n·C_n."""
    return np.where((order < 0) & (order % 2 == 1), 1j * math.pi, 0.0)


def _log_hankel(z: np.ndarray, orders: int) -> np.ndarray:
    """(orders + 1, Z) complex log H_n⁽¹⁾(z) by the upward recurrence, scaled at each step."""
    logs = np.empty((orders + 2, len(z)), np.complex128)
    before, here = special.hankel1(0, z), special.hankel1(1, z)
    scale = np.zeros(len(z))
    logs[0], logs[1] = np.log(before), np.log(here)
    for n in range(1, orders + 1):
        before, here = here, 2.0 * n / z * here - before
        size = np.abs(here)
        scale += np.log(size)
        before, here = before / size, here / size
        logs[n + 1] = np.log(here) + scale
    return logs[: orders + 1]


def _log_hankel_slopes(z: np.ndarray, orders: int) -> np.ndarray:
    """(orders + 1, Z) complex log H_n'(z), from H_n' = n/z·H_n - H_{n+1}."""
    logs = _log_hankel(z, orders + 1)
    n = np.arange(orders + 1)[:, None]
    return logs[1:] + np.log(n / z * np.exp(logs[:-1] - logs[1:]) - 1.0)


def _log_bessel_slopes(z: np.ndarray, orders: int) -> np.ndarray:
    """(orders + 1, Z) complex log J_n'(z), from J_n' = n/z·J_n - J_{n+1}; -inf where it is 0.

    By the downward recurrence, scaled at each step and then by J_0 or J_1, whichever is the larger.
    """
    last = max(orders + 1, order_count(float(z.max()))) + SPARE
    values, scale = np.zeros((last + 2, len(z))), np.zeros((last + 2, len(z)))
    above, here, total = np.zeros(len(z)), np.ones(len(z)), np.zeros(len(z))
    for n in range(last, 0, -1):
        above, here = here, 2.0 * n / z * here - above
        size = np.maximum(np.abs(here), np.abs(above))
        total = total + np.log(size)
        above, here = above / size, here / size
        values[n - 1], scale[n - 1] = here, total
    j0, j1 = special.j0(z), special.j1(z)
    by_j1 = np.abs(j1) > np.abs(j0)
    known = np.where(by_j1, j1 / values[1], j0 / values[0])
    offset = np.log(known + 0j) - np.where(by_j1, scale[1], scale[0])
    number = np.arange(orders + 1)[:, None]
    step = np.exp(scale[1 : orders + 2] - scale[: orders + 1])
    slopes = number / z * values[: orders + 1] - step * values[1 : orders + 2]
    with np.errstate(divide="ignore"):
        logs: np.ndarray = np.log(slopes + 0j) + scale[: orders + 1] + offset
    return logs


def _last_orders(ka: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(M,) the last order of each cylinder, by its size and by how near its neighbours are."""
    close = [math.ceil(math.log(CLOSE) / math.log(each)) if 0 < each < 1 else 0 for each in near]
    alone = [order_count(each) for each in ka]
    return np.maximum(alone, np.minimum(close, MOST_ORDERS)).astype(np.int64)


def _nearness(centre: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(M,) radius over the distance of the centre from the next rim: 0 far away, 1 touching."""
    gap = np.hypot(*(centre[:, None] - centre).T) - radius[:, None]  # from the rim of the row
    np.fill_diagonal(gap, np.inf)
    return radius / gap.min(axis=0, initial=np.inf)


def _check(
    centre: np.ndarray, radius: np.ndarray, source: np.ndarray, receiver: np.ndarray
) -> None:
    for name, places in (("source", source), ("receiver", receiver)):
        if len(radius) and np.any(radius >= np.hypot(*(places[:, None] - centre).T).T):
            raise ValueError(f"a trunk covers the {name}; leave it out or move the {name}")
    if len(radius) > 1:
        for i, j in KDTree(centre).query_pairs(2.0 * radius.max()):
            if math.dist(centre[i], centre[j]) <= radius[i] + radius[j]:
                raise ValueError(f"trunks {i} and {j} overlap; leave one of them out")
