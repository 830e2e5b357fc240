"""Flights as Gymnasium environments: one flyer (``FlightEnv``), or many in one forest (``FlightVectorEnv``).

::

    import gymnasium as gym, forest_addon.flight
    env = gym.make("ForestSensing/Flight-v0", scene="flight-poisson", sensors=("lidar", "sonar"))

What is sensed is a dict of arrays, ``lidar`` (rays,) metres, ``sonar`` (ears, ...), ``odometry``
(8,), float64 or, rounded to it, float32; an action is a number from -1 to 1 for each thing a body decides
(``bodies``). The reward is the metres nearer to the aim, -10 for a touch, 10 for arriving. Misuse that
Gymnasium has an error for gets that (``gymnasium.error``), settings that cannot be used a ``SpecError``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import error, logger, spaces
from gymnasium.utils import seeding
from gymnasium.vector.utils import batch_space

from ..api import World
from ..base.rng import stream
from ..spec import Flight, Mobile, Scene, Sonar, SpecError, unknown
from . import top_view
from .bodies import ACTIONS
from .listening import EchoTask, noisy, sensed
from .senses import (
    BANDS,
    BINS,
    FARTHEST,
    HEARD,
    ODOMETRY,
    EarSense,
    LidarSense,
    levels,
    lidar_of,
    sonar_of,
)
from .simulation import SENSORS, Flyers
from .stems import StemForests, poisson_forests
from .woods import Stock

FORESTS = ("new", "fixed")
SCENE = "flight-poisson"  # of assets/scenes, where none is given
MODES = ("rgb_array", "human")
DTYPES = ("float64", "float32")
NO_MODE = 'render() draws nothing without a mode; make the environment with render_mode="rgb_array"'


class _Flights:
    """Base of both environments: a stock of trees, flyers, and the spaces of one of them."""

    def __init__(
        self,
        count: int,
        scene: Scene | World | StemForests | str | Path,
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
        words = [("forest", forest, FORESTS), ("heard", heard, HEARD), ("dtype", dtype, DTYPES)]
        words += [("sensors", sensor, SENSORS) for sensor in sensors]
        for name, value, known in words:
            if value not in known:
                raise unknown(name, value, known)
        if every < 1:
            raise SpecError("every", f"{every} is out of range; use at least 1")
        if isinstance(scene, World):
            self.stock = Stock.standing(scene)
        elif isinstance(scene, StemForests):
            self.stock = scene
        else:
            self.stock = Stock(scene, folder)
        settings = self.stock.settings
        self.flight = flight or settings.flight
        if flight is not None:
            self.stock.settings = settings.changed(flight=flight)
        eyes = LidarSense(lidar or lidar_of(settings)) if "lidar" in sensors else None
        ears = (
            EarSense(sonar or sonar_of(settings), settings.air, heard, folder)
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
        self.trails: list[list[np.ndarray]] = []  # of each flyer, its places since it set out
        self.view: top_view.TopView | None = None

    def start(
        self, seeds: list[int], chosen: dict[str, Any], where: dict[str, Any]
    ) -> dict[str, np.ndarray]:
        """Plant the forest of an episode, set all flyers out and return what they sense."""
        self.enter(seeds[0], chosen)
        self.flyers.start(range(self.flyers.count), seeds, **where)
        self.trails = [[place.copy()] for place in self.flyers.state.position]
        if self.view is not None and self.view.world is not self.flyers.world:
            self.view = None
        return self.sense()

    def pictures(self) -> tuple[np.ndarray, ...]:
        """Pictures from above, one a flyer."""
        if self.view is None:
            self.view = top_view.TopView(self.flyers.world)
        ways = zip(self.trails, self.flyers.goal, self.flyers.state.heading.tolist(), strict=True)
        return tuple(self.view.draw(np.array(trail), *way) for trail, *way in ways)

    def enter(self, seed: int, options: dict[str, Any]) -> None:
        """Plant the forest of an episode."""
        wanted = options.get("forest", self.stock.settings.seed if self.forest == "fixed" else seed)
        if not (isinstance(wanted, int) and wanted >= 0):
            raise SpecError(
                "options.forest", f"{wanted!r} is no seed; use a whole number from 0 on"
            )
        if wanted != self._entered:
            self.flyers.enter(self.stock.surroundings(wanted))
            self._entered = wanted

    def sense(self) -> dict[str, np.ndarray]:
        """Observations of the flyers, a row a flyer."""
        return {
            name: values.astype(self.dtype, copy=False)
            for name, values in self.flyers.sense().items()
        }


def _started(options: dict[str, Any] | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Options of a reset, and those of them that say where a flight starts and goes.

    Raises
    ------
    SpecError : one that is not known.
    """
    options = {} if options is None else options
    if not isinstance(options, dict):
        raise SpecError("options", f"{options!r} is no dict of names and values")
    known = ("forest", "start", "goal", "heading_deg")
    for name in options:
        if name not in known:
            raise unknown("options", name, known)
    return options, {name: options[name] for name in known[1:] if name in options}


def _taken(space: spaces.Box, action: Any, unused: np.ndarray | None = None) -> np.ndarray:
    """Return an action that a space has, as float64. unused : (N,) bool, of rows that may be anything.

    Raises
    ------
    InvalidAction : the space does not have it: another shape, out of bounds, no number.
    """
    try:
        values = np.array(action)
    except ValueError:  # rows of different lengths
        values = np.array("ragged")
    if unused is not None and values.shape == space.shape:
        values[unused] = 0
    if values.dtype.kind not in "fiu" or not space.contains(values.astype(space.dtype)):
        raise error.InvalidAction(f"{action!r} is not in {space}; nothing was flown")
    return values.astype(np.float64)


def _refuse_mode(mode: str | None, known: tuple[str, ...]) -> None:
    if mode not in (None, *known):
        raise error.UnsupportedMode(str(unknown("render_mode", str(mode), known)))


class FlightEnv(gymnasium.Env):
    """One flyer.

    scene : a scene file or the name of one of assets/scenes, a ``Scene``, ``StemForests``, or a ``World``
    (what stands in Blender: its forest stays the same).
    sensors : of "lidar" and "sonar" those that it carries. flight, lidar, sonar : in place of the scene's.
    heard : what the sonar tells, "cochleagram" or "waveforms". every : steps from ping to ping.
    forest : "new" at every reset, or "fixed", the scene's own. folder : that relative paths start from.
    dtype : of what is sensed, and of actions.

    ``reset(options=…)`` takes "forest" (a seed), "start" and "goal" (metres) and "heading_deg".
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(MODES), "render_fps": 20}

    def __init__(
        self,
        scene: Scene | World | StemForests | str | Path = SCENE,
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
        _refuse_mode(render_mode, MODES)
        self.flights = _Flights(
            1, scene, tuple(sensors), flight, lidar, sonar, heard, every, forest, folder, dtype
        )
        self.observation_space = self.flights.observed
        self.action_space = self.flights.actions
        self.render_mode = render_mode
        self._flies = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode; see ``gymnasium.Env``.

        Raises
        ------
        SpecError : a start that touches something, an option that is not known.
        """
        super().reset(seed=seed)
        self._flies = False
        chosen, where = _started(options)
        own = int(self.np_random.integers(2**31)) if seed is None else seed
        seen = _first(self.flights.start([own], chosen, where))
        self._flies = True
        self._show()
        return seen, self._info()

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Fly a step; see ``gymnasium.Env``.

        Raises
        ------
        InvalidAction : the action space does not have it; the episode is untouched.
        ResetNeeded : no flight has begun, or it has ended.
        """
        if not self._flies:
            raise error.ResetNeeded("Call reset() before step(): no flight has begun, or it ended")
        flyers = self.flights.flyers
        out = flyers.step(_taken(self.action_space, action)[None])
        self._flies = not out.ended[0]
        self.flights.trails[0].append(flyers.state.position[0].copy())
        seen = _first(self.flights.sense())
        self._show()
        crashed, arrived = bool(out.crashed[0]), bool(out.arrived[0])
        info = self._info() | {"crashed": crashed, "arrived": arrived}
        return seen, float(out.reward[0]), crashed or arrived, bool(out.late[0]), info

    def render(self) -> np.ndarray | None:
        """The picture of "rgb_array"; "human" shows its own.

        Raises
        ------
        ResetNeeded : no flight has begun.
        """
        if self.render_mode is None:
            logger.warn(NO_MODE)
        elif not self.flights.trails:
            raise error.ResetNeeded("Call reset() before render(): no flight has begun")
        return self.flights.pictures()[0] if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.flights.view is not None:
            self.flights.view.close()
            self.flights.view = None

    def world(self) -> World:
        """The forest of this episode, built in Blender; see ``FlightSurroundings.world``."""
        return self.flights.flyers.world.world()

    def _info(self) -> dict[str, Any]:
        flyers = self.flights.flyers
        return {
            "position": flyers.state.position[0].copy(),
            "heading": float(flyers.state.heading[0]),
            "flown": float(flyers.flown[0]),
            "forest": self.flights._entered,
        }

    def _show(self) -> None:
        if self.render_mode == "human":
            pictures = self.flights.pictures()
            self.flights.view.show(pictures[0])  # type: ignore[union-attr]  # just made


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
        scene: Scene | World | StemForests | str | Path = SCENE,
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
        _refuse_mode(render_mode, MODES[:1])
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
        self._next: list[int] = []

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin the episodes of all flyers."""
        self._refuse_closed("reset")
        self._next = []
        chosen, where = _started(options)
        if isinstance(seed, (list, tuple)):
            seeds = [
                int(seeding.np_random()[0].integers(2**31))
                if one is None
                else seeding.np_random(one)[1]
                for one in seed
            ]
        else:
            super().reset(seed=seed)
            first = int(self.np_random.integers(2**31)) if seed is None else seed
            seeds = [first + i for i in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise error.Error(f"There are {len(seeds)} seeds; give {self.num_envs}, or one")
        seen = self.flights.start(seeds, chosen, where)
        self._where, self._next = where, seeds
        self._over[:] = False
        return seen, self._info()

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly a step of all flyers.

        Raises
        ------
        InvalidAction : the action space does not have them; no flyer has moved.
        ResetNeeded : no flight has begun.
        """
        self._refuse_closed("step")
        if not self._next:
            raise error.ResetNeeded("Call reset() before step(): no flight has begun")
        flyers, again = self.flights.flyers, self._over.copy()
        out = flyers.step(_taken(self.action_space, actions, again))
        crashed, arrived, late, reward = out.crashed, out.arrived, out.late, out.reward
        if again.any():
            rows = np.flatnonzero(again).tolist()
            for row in rows:  # the next of this flyer's episodes
                self._next[row] = int(stream(self._next[row], "flight", "next").integers(2**31))
            flyers.start(rows, [self._next[row] for row in rows], **self._where)
            crashed, arrived, late = crashed & ~again, arrived & ~again, late & ~again
            reward = np.where(again, 0.0, reward)
        self._over = crashed | arrived | late
        for row, place in enumerate(flyers.state.position if self.render_mode else ()):
            kept = [] if again[row] else self.flights.trails[row]
            self.flights.trails[row] = [*kept, place.copy()]
        info = self._info() | {"crashed": crashed, "arrived": arrived}
        return self.flights.sense(), reward, crashed | arrived, late, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The pictures of "rgb_array", one a flyer; before the first reset there are none."""
        return self.flights.pictures() if self.render_mode and self.flights.trails else None

    def _refuse_closed(self, doing: str) -> None:
        if self.closed:
            raise error.ClosedEnvironmentError(f"Trying to operate on `{doing}` after close()")

    def _info(self) -> dict[str, Any]:
        flyers = self.flights.flyers
        return {
            "position": flyers.state.position.copy(),
            "heading": flyers.state.heading.copy(),
            "flown": flyers.flown.copy(),
        }


class PoissonEnv(FlightEnv):
    """A bird among trunks at random (``stems.poisson_forests``), which needs no Blender.

    density : trees/m². speed : m/s. distance : metres to fly. given : as of ``FlightEnv``.
    """

    def __init__(
        self, density: float = 0.1, speed: float = 4.0, distance: float = 100.0, **given: Any
    ) -> None:
        super().__init__(poisson_forests(density, speed, distance), **given)


class PoissonVectorEnv(FlightVectorEnv):
    """Many birds in one such forest; arguments as of ``PoissonEnv``."""

    def __init__(
        self,
        num_envs: int,
        density: float = 0.1,
        speed: float = 4.0,
        distance: float = 100.0,
        **given: Any,
    ) -> None:
        super().__init__(num_envs, poisson_forests(density, speed, distance), **given)


class ListenEnv(gymnasium.Env):
    """One echo, then a guess: is it there, a passage in a hedge or a pole among leaves?

    what, distance, width : as of ``listening.EchoTask``. snr_db : peak over noise, None: no noise.
    An action is 0 (no) or 1 (yes), the reward 1 for what is right; ``info`` tells the truth after the guess.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        what: str = "passage",
        distance: float = 1.4,
        width: float | None = None,
        snr_db: float | None = None,
        render_mode: str | None = None,
    ) -> None:
        _refuse_mode(render_mode, ())
        self.task = EchoTask(what, distance, width)
        self.snr_db = snr_db
        self.observation_space = spaces.Box(0.0, 1.0, (BANDS, BINS))
        self.action_space = spaces.Discrete(2)
        self._truth: int | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Hear another echo; see ``gymnasium.Env``. It takes no options."""
        super().reset(seed=seed)
        for name in options or ():
            raise unknown("options", name, ())
        truth, own = self.np_random.integers((2, 2**31)).tolist()
        sound = self.task.heard(own, 0, bool(truth))
        if self.snr_db is not None:
            sound = noisy(sound, self.snr_db, self.task.loudness(), own, 0)
        self._truth = truth
        return levels(sensed(sound)).astype(np.float32), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Guess; see ``gymnasium.Env``.

        Raises
        ------
        InvalidAction : neither 0 nor 1. ResetNeeded : nothing was heard since the last guess.
        """
        if self._truth is None:
            raise error.ResetNeeded("Call reset() before step(): each echo takes one guess")
        if not self.action_space.contains(action):
            raise error.InvalidAction(f"{action!r} is not in {self.action_space}")
        truth, self._truth = self._truth, None
        nothing = np.zeros((BANDS, BINS), np.float32)
        return nothing, float(action == truth), True, False, {"truth": truth}


def _first(told: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The one flyer's rows of arrays that have a row for each flyer."""
    return {name: values[0] for name, values in told.items()}
