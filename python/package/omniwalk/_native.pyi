"""The compiled half of the package."""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, TypedDict, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

class Error(ValueError):
    """What omniwalk cannot do, and what would be right."""

def crosscheck(arguments: list[str]) -> int:
    """Runs `omniwalk crosscheck` with `arguments`; its exit code."""

def wrong(argument: str, right: str, given: object) -> Error:
    """The error that says what `argument` must be, and what was given instead."""

class GoldenStep(TypedDict):
    """Readings of a golden step, and what must come out."""

    position: NDArray[np.float32]
    velocity: NDArray[np.float32]
    attitude: NDArray[np.float32]
    gyro: NDArray[np.float32]
    desired: NDArray[np.float32]
    base_velocity: NDArray[np.float32] | None
    observation: NDArray[np.float32]
    targets: NDArray[np.float32]

class Golden(TypedDict):
    """The golden vectors of a policy."""

    clock_phase: float
    actions: list[tuple[NDArray[np.float32], NDArray[np.float32]]]
    steps: list[GoldenStep]

@final
class OutOfRange:
    """An entry of the observation beyond what training saw; it was clipped."""

    @property
    def entry(self) -> int:
        """Index into the observation; of several, the one farthest out by its range."""
    @property
    def name(self) -> str:
        """Its name."""
    @property
    def value(self) -> float:
        """The value before it was clipped."""
    @property
    def excess(self) -> float:
        """By how much it was beyond the nearer bound, positive."""
    @property
    def entries(self) -> int:
        """How many entries were out of range."""

@final
class Status:
    """What a step says beside its targets."""

    @property
    def mode(self) -> Literal["walking", "holding", "ramping", "resting"]:
        """What the targets are."""
    @property
    def fault(self) -> Literal["stale", "not_finite", "absurd", "fallen", "over_rate"] | None:
        """What kept the policy from this step."""
    @property
    def message(self) -> str:
        """What is not as it should be, in words; empty if all is."""
    @property
    def out_of_range(self) -> OutOfRange | None:
        """An observation that training did not see."""
    @property
    def command(self) -> Literal["taken", "clipped", "not_finite"]:
        """What became of the desired velocity."""
    @property
    def late(self) -> float:
        """How much later the step came than its period after the one before, s; 0 if within half a period."""
    @property
    def ok(self) -> bool:
        """True if the policy walks on readings and a command like those of training, in time."""

@final
class Controller:
    """A policy in its loop on a robot."""

    def __new__(cls, policy: str | PathLike[str] | bytes, *, portable: bool = False) -> Controller:
        """The policy in a file, given by its path or as its bytes; it reproduces its golden vectors, or is refused.
        `portable` does without the instructions that not every processor has."""
    @property
    def joints(self) -> list[str]:
        """Names of the policy's joints, in the order of every array."""
    @property
    def observation_names(self) -> list[str]:
        """Names of the observation's entries."""
    @property
    def nominal(self) -> NDArray[np.float32]:
        """Nominal pose, rad or m."""
    @property
    def lower(self) -> NDArray[np.float32]:
        """Lower position limits, rad or m."""
    @property
    def upper(self) -> NDArray[np.float32]:
        """Upper position limits, rad or m."""
    @property
    def kp(self) -> NDArray[np.float32]:
        """Position gains of the actuators, N m/rad or N/m."""
    @property
    def kd(self) -> NDArray[np.float32]:
        """Velocity gains of the actuators, N m s/rad or N s/m."""
    @property
    def torque_limit(self) -> NDArray[np.float32]:
        """Torque limits of the actuators, N m or N."""
    @property
    def command_range(self) -> tuple[list[float], list[float]]:
        """Smallest and largest desired velocity that was trained, m/s, m/s, rad/s."""
    @property
    def control_hz(self) -> float:
        """Control rate, Hz."""
    @property
    def period(self) -> int:
        """Control period, ns."""
    @property
    def instruction_set(self) -> str:
        """Name of the instruction set the network runs with."""
    @property
    def observation(self) -> NDArray[np.float32]:
        """The observation of the last step of the policy, before bounds, as the policy sees it: mirrored in the second half of a
        symmetric policy's cycle."""
    @property
    def action(self) -> NDArray[np.float32]:
        """The action of the last step of the policy, in [0, 1]; not a number while the targets were held."""
    def verify(self) -> None:
        """Runs the golden vectors again."""
    def golden(self) -> Golden:
        """The golden vectors: `steps` are from a reset at `clock_phase` on."""
    def check_joints(self, names: Sequence[str]) -> None:
        """Checks that `names`, the order in which you give readings and take targets, is the policy's."""
    def joint_map(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Index among `names`, your robot's joints, of each of the policy's joints."""
    def check_robot(self, robot: Robot) -> None:
        """Checks that the policy was trained for `robot`: joints, limits, gains, nominal pose, kinematics."""
    def reset(self, phase: float | None = None) -> None:
        """Starts an episode with the clock at `phase`, in cycles, or where the policy begins; a fall is forgotten. The
        robot should stand in the nominal pose."""
    def take_over(self, position: ArrayLike | dict[str, float]) -> None:
        """Starts with a robot in whatever pose: ramps to the nominal pose, rests, then walks.

        Raises Error if a position is not finite or well beyond its joint's limits. Then send no targets to servos that are
        on: steps hold what was told last, with the fault, until one of them has good readings, from which the takeover
        begins."""
    @overload
    def step(
        self,
        now: int,
        measured: int,
        position: dict[str, float],
        velocity: dict[str, float] | ArrayLike,
        attitude: ArrayLike,
        gyro: ArrayLike,
        desired: ArrayLike,
        base_velocity: ArrayLike | None = None,
    ) -> tuple[dict[str, float], Status]: ...
    @overload
    def step(
        self,
        now: int,
        measured: int,
        position: ArrayLike,
        velocity: ArrayLike | dict[str, float],
        attitude: ArrayLike,
        gyro: ArrayLike,
        desired: ArrayLike,
        base_velocity: ArrayLike | None = None,
        *,
        out: NDArray[np.float32] | None = None,
    ) -> tuple[NDArray[np.float32], Status]:
        """One step, to be made once a control period: the targets (rad or m, finite, within limits) and a status.

        `now` and `measured` are the times of the step and of its readings, ns on one clock that does not jump. `attitude` is the fused
        roll and pitch of the base, rad; `gyro` its rates about its own axes, rad/s; `desired` forward, left and turning to the left, m/s and rad/s. `position` and
        `velocity` are arrays in the policy's order, or dictionaries by joint name, which may hold other joints too; then
        the targets are a dictionary. `out` is the array to write the targets to."""
    def act(self, observations: ArrayLike, *, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Actions in [0, 1] for observations, a row each or a single one, without advancing the loop."""

@final
class Robot:
    """A robot, loaded and checked."""

    def __new__(cls, path: str | PathLike[str]) -> Robot:
        """The robot in the folder or URDF at `path`."""
    @property
    def name(self) -> str:
        """The robot's name."""
    @property
    def floating(self) -> bool:
        """Whether its base floats; otherwise it is bolted to the world."""
    @property
    def mass(self) -> float:
        """Mass, kg."""
    @property
    def joints(self) -> list[str]:
        """Names of the joints the policy moves, in the order of every array."""
    @property
    def all_joints(self) -> list[str]:
        """Names of all moving joints."""
    @property
    def links(self) -> list[str]:
        """Names of the links."""
    @property
    def feet(self) -> list[str]:
        """Names of the feet."""
    @property
    def notes(self) -> list[str]:
        """What loading had to assume."""
    @property
    def nominal(self) -> NDArray[np.float64]:
        """Nominal pose, rad or m."""
    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower position limits, rad or m."""
    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper position limits, rad or m."""
    @property
    def kp(self) -> NDArray[np.float64]:
        """Position gains, N m/rad or N/m."""
    @property
    def kd(self) -> NDArray[np.float64]:
        """Velocity gains, N m s/rad or N s/m."""
    @property
    def torque_limit(self) -> NDArray[np.float64]:
        """Largest torques at standstill, N m or N."""
    def describe(self) -> str:
        """Everything that decides how it moves, in tables for people."""

@final
class Batch:
    """Environments side by side, stepped by threads of their own.

    The arrays it gives are read-only views of its memory, the same ones for its whole life: every step writes over them."""

    def __new__(
        cls,
        config: str | PathLike[str] | None = None,
        changes: Sequence[str] = (),
        num_envs: int | None = None,
        threads: int | None = None,
    ) -> Batch:
        """Environments under the configuration in the file `config`, laid over the defaults, with `changes` (`key=value`)
        over that: `num_envs` of them or as many as it says, stepped by `threads` or by all cores."""
    @property
    def environments(self) -> int:
        """Number of environments."""
    @property
    def observation_len(self) -> int:
        """Entries of an observation."""
    @property
    def action_len(self) -> int:
        """Entries of an action."""
    @property
    def control_hz(self) -> float:
        """Control rate, Hz."""
    @property
    def threads(self) -> int:
        """Threads that step it."""
    @property
    def joints(self) -> list[str]:
        """Names of the policy's joints."""
    @property
    def observation_names(self) -> list[str]:
        """Names of the observation's entries."""
    @property
    def term_names(self) -> list[str]:
        """Names of the rewards' terms."""
    @property
    def observations(self) -> NDArray[np.float32]:
        """Observations that wait for an action, a row for each environment."""
    @property
    def final_observations(self) -> NDArray[np.float32]:
        """The last observations of the episodes that ended in the last step; other rows are meaningless."""
    @property
    def rewards(self) -> NDArray[np.float32]:
        """Rewards of the last step, one for each environment."""
    @property
    def terms(self) -> NDArray[np.float64]:
        """The rewards' terms in the order of `term_names`, a row for each environment."""
    @property
    def terminated(self) -> NDArray[np.bool_]:
        """Where the robot fell, or its legs passed through each other, in the last step."""
    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Where the time was over in the last step."""
    def reset(self, seed: int | None = None) -> None:
        """Starts the next episode everywhere, or with a `seed` over with the first episodes of that seed."""
    def step(self, actions: NDArray[np.float32]) -> None:
        """One control step with `actions` in [-1, 1], a row for each environment, an entry for each joint; what is beyond is
        clipped. Episodes that end start anew at once."""
    def take_episodes(self) -> str:
        """The episodes that ended since the last call, as JSON."""
    def desired(self, environment: int) -> list[float]:
        """The desired velocity of an environment, m/s, m/s, rad/s."""
    def set_desired(self, environment: int, velocity: Sequence[float]) -> None:
        """Sets the desired velocity of an environment (m/s, m/s, rad/s), from its next observation on and in later episodes."""
    def set_command_range(self, lower: Sequence[float], upper: Sequence[float]) -> None:
        """Sets where every environment draws desired velocities from, from its next draw on (m/s, m/s, rad/s)."""
    def set_factors(self, velocity: float, foot: float, push: float) -> None:
        """Sets the curriculum's factors on the velocity and the foot term of the reward, and on the largest force of pushes; all are 1 at first."""
