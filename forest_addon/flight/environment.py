"""Flights as Gymnasium environments: one flyer (``FlightEnv``), or many in one forest (``FlightVectorEnv``).

::

    import gymnasium as gym, forest_addon.flight
    scene = "assets/scenes/flight-poisson.toml"
    env = gym.make("ForestSensing/Flight-v0", scene=scene, sensors=("lidar", "sonar"))

What is sensed is a dict of arrays, ``lidar`` (rays,) metres, ``sonar`` (ears, ...), ``odometry``
(8,), float64 or, rounded to it, float32; an action is a number from -1 to 1 for each thing a body decides
(``bodies``). The reward is the metres nearer to the aim, -10 for a touch, 10 for arriving.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space

from ..api import World
from ..spec import Flight, Mobile, Scene, Sonar, SpecError, unknown
from . import top_view
from .bodies import ACTIONS
from .senses import FARTHEST, HEARD, ODOMETRY, EarSense, LidarSense, lidar_of, sonar_of
from .simulation import SENSORS, Flyers
from .woods import FlightSurroundings, Stock

FORESTS = ("new", "fixed")
MODES = ("rgb_array", "human")
DTYPES = ("float64", "float32")


class _Flights:
    """Base of both environments: a stock of trees, flyers, and the spaces of one of them."""

    def __init__(
        self,
        count: int,
        scene: Scene | World | str | Path,
        sensors: tuple[str, ...],
        flight: Flight | None,
        lidar: Mobile | None,
        sonar: Sonar | None,
        heard: str,
        every: int,
        forest: str,
        folder: str | Path,
        dtype: str,
    ) -> None:
        words = (("forest", forest, FORESTS), ("heard", heard, HEARD), ("dtype", dtype, DTYPES))
        for name, value, known in words:
            if value not in known:
                raise unknown(name, value, known)
        for sensor in sensors:
            if sensor not in SENSORS:
                raise unknown("sensors", sensor, SENSORS)
        if every < 1:
            raise SpecError("every", f"{every} is out of range; use at least 1")
        if isinstance(scene, World):
            self.stock = Stock.standing(scene)
        else:
            self.stock = Stock(scene, folder)
        settings = self.stock.settings
        self.flight = flight or settings.flight
        if flight is not None:
            self.stock.settings = settings.changed(flight=flight)
        eyes = LidarSense(lidar or lidar_of(settings)) if "lidar" in sensors else None
        ears = (
            EarSense(sonar or sonar_of(settings), settings.air, heard)
            if "sonar" in sensors
            else None
        )
        self.flyers = Flyers(self.flight, count, eyes, ears, every)
        self.forest = forest
        self._entered: int | None = None
        self.dtype: Any = np.dtype(dtype).type
        told: dict[str, spaces.Space] = {}
        if eyes:
            told["lidar"] = spaces.Box(0.0, eyes.scanner.max_range, (eyes.rays,), self.dtype)
        if ears:
            low, high = (0.0, 1.0) if heard == "cochleagram" else (-FARTHEST, FARTHEST)
            told["sonar"] = spaces.Box(low, high, ears.shape, self.dtype)
        told["odometry"] = spaces.Box(-FARTHEST, FARTHEST, (ODOMETRY,), self.dtype)
        self.observed = spaces.Dict(told)
        self.actions = spaces.Box(-1.0, 1.0, (len(ACTIONS[self.flight.body]),), self.dtype)

    def enter(self, seed: int, options: dict[str, Any]) -> None:
        """Plant the forest of an episode."""
        wanted = options.get("forest", self.stock.settings.seed if self.forest == "fixed" else seed)
        if wanted != self._entered:
            self.flyers.enter(self.stock.surroundings(int(wanted)))
            self._entered = wanted

    def sense(self) -> dict[str, np.ndarray]:
        """Return what the flyers sense, a row a flyer."""
        return {
            name: values.astype(self.dtype, copy=False)
            for name, values in self.flyers.sense().items()
        }

    @property
    def surroundings(self) -> FlightSurroundings:
        """Return where the flyers are."""
        return self.flyers.world


def _started(options: dict[str, Any] | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Options of a reset, and those of them that say where a flight starts and goes.

    Raises
    ------
    SpecError : one that is not known.
    """
    options = dict(options or {})
    known = ("forest", "start", "goal", "heading_deg")
    for name in options:
        if name not in known:
            raise unknown("options", name, known)
    return options, {name: options[name] for name in known[1:] if name in options}


class FlightEnv(gymnasium.Env):
    """One flyer.

    scene : a scene file, a ``Scene``, or a ``World`` (what stands in Blender: its forest stays the same).
    sensors : of "lidar" and "sonar" those that it carries. flight, lidar, sonar : in place of the scene's.
    heard : what the sonar tells, "cochleagram" or "waveforms". every : steps from ping to ping.
    forest : "new" at every reset, or "fixed", the scene's own. folder : that relative paths start from.
    dtype : of what is sensed, and of actions.

    ``reset(options=…)`` takes "forest" (a seed), "start" and "goal" (metres) and "heading_deg".
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(MODES), "render_fps": 20}

    def __init__(
        self,
        scene: Scene | World | str | Path,
        sensors: tuple[str, ...] = ("lidar",),
        flight: Flight | None = None,
        lidar: Mobile | None = None,
        sonar: Sonar | None = None,
        heard: str = "cochleagram",
        every: int = 1,
        forest: str = "new",
        folder: str | Path = ".",
        render_mode: str | None = None,
        dtype: str = "float64",
    ) -> None:
        if render_mode not in (None, *MODES):
            raise unknown("render_mode", render_mode, MODES)
        self.flights = _Flights(
            1, scene, tuple(sensors), flight, lidar, sonar, heard, every, forest, folder, dtype
        )
        self.observation_space = self.flights.observed
        self.action_space = self.flights.actions
        self.render_mode = render_mode
        self._view: top_view.TopView | None = None
        self._trail: list[np.ndarray] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode; see ``gymnasium.Env``.

        Raises
        ------
        SpecError : a start that touches something, an option that is not known.
        """
        super().reset(seed=seed)
        chosen, where = _started(options)
        own = int(self.np_random.integers(2**31)) if seed is None else int(seed)
        flyers = self.flights.flyers
        self.flights.enter(own, chosen)
        flyers.start([0], [own], **where)
        self._seed, self._ended = own, False
        self._trail = [flyers.state.position[0].copy()]
        if self._view is not None and self._view.world is not self.flights.surroundings:
            self._view = None
        seen = _first(self.flights.sense())
        if self.render_mode == "human":
            self._show()
        return seen, self._info()

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Fly a step; see ``gymnasium.Env``.

        Raises
        ------
        SpecError : an action that cannot be used; the episode is untouched.
        """
        flyers = self.flights.flyers
        out = flyers.step(np.asarray(action, dtype=np.float64)[None])
        if self.render_mode is not None:
            self._trail.append(flyers.state.position[0].copy())
        seen = _first(self.flights.sense())
        if self.render_mode == "human":
            self._show()
        crashed, arrived = bool(out.crashed[0]), bool(out.arrived[0])
        info = self._info() | {"crashed": crashed, "arrived": arrived}
        return seen, float(out.reward[0]), crashed or arrived, bool(out.late[0]), info

    def render(self) -> np.ndarray | None:
        """The picture of "rgb_array"; "human" shows its own."""
        return self._picture() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._view is not None:
            self._view.close()
            self._view = None

    def world(self) -> World:
        """The forest of this episode, built in Blender; see ``FlightSurroundings.world``."""
        return self.flights.surroundings.world()

    def _info(self) -> dict[str, Any]:
        flyers = self.flights.flyers
        return {
            "position": flyers.state.position[0].copy(),
            "heading": float(flyers.state.heading[0]),
            "flown": float(flyers.flown[0]),
            "forest": self.flights._entered,
        }

    def _picture(self) -> np.ndarray:
        flyers = self.flights.flyers
        if self._view is None:
            self._view = top_view.TopView(self.flights.surroundings)
        lidar = flyers.lidar
        return self._view.draw(
            np.array(self._trail),
            flyers.goal[0],
            float(flyers.state.heading[0]),
            lidar and lidar.scanner.max_range,
        )

    def _show(self) -> None:
        picture = self._picture()
        self._view.show(picture)


class FlightVectorEnv(gymnasium.vector.VectorEnv):
    """Many flyers in one forest that do not meet each other; their rays are cast in one call.

    Arguments as of ``FlightEnv``, and num_envs. ``reset(seed=s)`` plants the forest of seed s and starts
    flyer i as ``FlightEnv.reset(seed=s + i, options={"forest": s})`` does. A flyer whose flight has ended
    starts anew in the same forest on the next step, whose action for it is not used (Gymnasium's next-step
    mode).
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": ["rgb_array"],
        "render_fps": 20,
        "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        scene: Scene | World | str | Path,
        sensors: tuple[str, ...] = ("lidar",),
        flight: Flight | None = None,
        lidar: Mobile | None = None,
        sonar: Sonar | None = None,
        heard: str = "cochleagram",
        every: int = 1,
        forest: str = "new",
        folder: str | Path = ".",
        render_mode: str | None = None,
        dtype: str = "float64",
    ) -> None:
        if num_envs < 1:
            raise SpecError("num_envs", f"{num_envs} is out of range; use at least 1")
        if render_mode not in (None, "rgb_array"):
            raise unknown("render_mode", render_mode, ("rgb_array",))
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.flights = _Flights(
            num_envs,
            scene,
            tuple(sensors),
            flight,
            lidar,
            sonar,
            heard,
            every,
            forest,
            folder,
            dtype,
        )
        self.single_observation_space = self.flights.observed
        self.single_action_space = self.flights.actions
        self.observation_space = batch_space(self.flights.observed, num_envs)
        self.action_space = batch_space(self.flights.actions, num_envs)
        self._over = np.zeros(num_envs, dtype=bool)
        self._view: top_view.TopView | None = None
        self._trails: list[list[np.ndarray]] = []

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin the episodes of all flyers."""
        chosen, where = _started(options)
        if seed is None:
            seed = int(self.np_random.integers(2**31))
        elif isinstance(seed, int):
            super().reset(seed=seed)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else list(seed)
        if len(seeds) != self.num_envs:
            raise SpecError("seed", f"has {len(seeds)} numbers; give {self.num_envs}, or one")
        self.flights.enter(int(seeds[0]), chosen)
        self._where, self._next = where, [int(s) for s in seeds]
        self.flights.flyers.start(range(self.num_envs), self._next, **where)
        self._over[:] = False
        if self.render_mode is not None:
            self._trails = [[place.copy()] for place in self.flights.flyers.state.position]
            self._view = top_view.TopView(self.flights.surroundings)
        return self.flights.sense(), self._info()

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly a step of all flyers.

        Raises
        ------
        SpecError : an action that cannot be used; no flyer has moved.
        """
        flyers, again = self.flights.flyers, self._over.copy()
        actions = np.array(actions, dtype=np.float64)
        if again.any() and actions.shape[:1] == again.shape:
            actions[again] = 0.0
        out = flyers.step(actions)
        crashed, arrived, late, reward = out.crashed, out.arrived, out.late, out.reward
        if again.any():
            rows = np.flatnonzero(again).tolist()
            for row in rows:  # the next of this flyer's episodes
                self._next[row] = int(generator_of(self._next[row]).integers(2**31))
            flyers.start(rows, [self._next[row] for row in rows], **self._where)
            crashed, arrived, late = crashed & ~again, arrived & ~again, late & ~again
            reward = np.where(again, 0.0, reward)
        self._over = crashed | arrived | late
        for row, place in enumerate(flyers.state.position if self._trails else ()):
            kept = [] if again[row] else self._trails[row]
            self._trails[row] = [*kept, place.copy()]
        info = self._info() | {"crashed": crashed, "arrived": arrived}
        return self.flights.sense(), reward, crashed | arrived, late, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The pictures of "rgb_array", one a flyer; before the first reset there are none."""
        if self._view is None:
            return None
        flyers, reach = self.flights.flyers, self.flights.flyers.lidar
        return tuple(
            self._view.draw(
                np.array(trail), goal, float(heading), reach and reach.scanner.max_range
            )
            for trail, goal, heading in zip(
                self._trails, flyers.goal, flyers.state.heading, strict=True
            )
        )

    def _info(self) -> dict[str, Any]:
        flyers = self.flights.flyers
        return {
            "position": flyers.state.position.copy(),
            "heading": flyers.state.heading.copy(),
            "flown": flyers.flown.copy(),
        }


def generator_of(seed: int) -> np.random.Generator:
    """The chances of which episode follows one of this seed."""
    from ..base.rng import stream

    return stream(seed, "flight", "next")


def _first(told: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The one flyer's rows of arrays that have a row for each flyer."""
    return {name: values[0] for name, values in told.items()}
