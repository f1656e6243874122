"""An experiment: what is commanded, for how long, in which mode. Saved as a TOML."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field

from smsid._explain import validate_tables
from smsid._files import atomic_write, with_sum
from smsid._reading import read_toml
from smsid._short_repr import ShortRepr
from smsid.errors import ExperimentError
from smsid.inputs.inputs import Inputs, JointMotion
from smsid.inputs.signals import Constant, Fourier, PiecewiseConstant, Signal
from smsid.model.spacecraft import SpacecraftModel


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _table(rows: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Return rows as an array (n, m); raises `ExperimentError` where one has another length."""
    if len({len(row) for row in rows}) > 1:
        lengths = ", ".join(str(len(row)) for row in rows[:6])
        raise ExperimentError(
            f"Rows of a profile have {lengths} numbers.", advice="Give every row as many as there are axes."
        )
    return np.array(rows, dtype=float)


class StepProfile(_Table):
    """Piecewise constant: ``values[i]`` from ``times[i]`` [s] on."""

    kind: Literal["steps"] = "steps"
    times: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]

    def signal(self) -> Signal:
        """Return the signal."""
        return PiecewiseConstant(self.times, _table(self.values))


class FourierProfile(_Table):
    """Truncated Fourier series; ``cos`` and ``sin`` hold one row per component, ``frequency`` in Hz.

    Raises `ExperimentError` when their sizes differ.
    """

    kind: Literal["fourier"] = "fourier"
    frequency: float = Field(gt=0.0)
    cos: tuple[tuple[float, ...], ...]
    sin: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...] | None = None

    def signal(self) -> Fourier:
        """Return the signal."""
        cos, sin = _table(self.cos), _table(self.sin)
        if cos.shape != sin.shape or cos.ndim != 2:
            raise ExperimentError(
                "`cos` and `sin` of a Fourier series need the same number of rows and terms."
            )
        offset = np.zeros(len(cos)) if self.offset is None else np.array(self.offset, dtype=float)
        return Fourier(self.frequency, cos, sin, offset)


class ConstantProfile(_Table):
    """A constant."""

    kind: Literal["constant"] = "constant"
    value: tuple[float, ...]

    def signal(self) -> Signal:
        """Return the signal."""
        return Constant(np.array(self.value, dtype=float))


Profile = Annotated[StepProfile | FourierProfile | ConstantProfile, Field(discriminator="kind")]


class Experiment(ShortRepr, _Table):
    """What is flown.

    ``force`` [N] at the thrust point and ``torque`` [N m] on the bus, body axes; ``thruster``, of each single
    thruster the share of its full thrust; ``wheel_torque`` and
    ``joint_torque`` [N m]; ``joint_motion`` [rad] prescribes all arm joints by a Fourier series (its rates
    and accelerations follow; the torque that takes is recorded as commanded). ``joints`` overrides the start
    angles.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    name: str
    note: str = ""
    duration: float = Field(gt=0.0)  # [s]
    hold_attitude: bool = False
    lock_joints: bool = False
    lock_wheels: bool = False
    force: Profile | None = None
    torque: Profile | None = None
    thruster: Profile | None = None
    wheel_torque: Profile | None = None
    joint_torque: Profile | None = None
    joint_motion: FourierProfile | None = None
    joints: tuple[float, ...] | None = None

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    def _title_and_rows(self) -> tuple[str, list[tuple[str, str]]]:
        stated = {n: getattr(self, n) for n in type(self).model_fields if n not in ("schema_version", "name")}
        rows = [
            (name, str(getattr(value, "kind", value)))  # of a profile its kind
            for name, value in stated.items()
            if value not in (None, False, "")
        ]
        return f"experiment {self.name!r}", rows

    def inputs(self) -> Inputs:
        """Return the inputs of a simulation."""
        motion = None if self.joint_motion is None else JointMotion.of(self.joint_motion.signal())
        names = ("force", "torque", "thruster", "wheel_torque", "joint_torque")
        found: dict[str, Any] = {k: p.signal() for k in names if (p := getattr(self, k)) is not None}
        held: dict[str, Any] = {k: getattr(self, k) for k in ("lock_joints", "lock_wheels", "hold_attitude")}
        return Inputs(**found, **held, joint_motion=motion)

    def start(self, model: SpacecraftModel) -> np.ndarray:
        """Return the start configuration q (nq,).

        Raises `ExperimentError` if ``joints`` does not fit the arms.
        """
        if self.joints is None:
            return model.home
        if len(self.joints) != len(model.arm_joints):
            raise ExperimentError(
                f"Experiment '{self.name}' starts {len(self.joints)} joints, the spacecraft has "
                f"{len(model.arm_joints)}.",
                advice=f"Its joints are {', '.join(model.arm_joints.names)}.",
            )
        return model.set_joint_angles(model.home, np.array(self.joints))


def load_experiment(path: str | os.PathLike[str]) -> Experiment:
    """Load an experiment from its TOML; raises `ExperimentError` naming the place and the mend."""
    tables = read_toml(path, ExperimentError)
    return validate_tables(Experiment, tables, f"'{path}'", ExperimentError, kind="experiment")


def save_experiment(experiment: Experiment, path: str | os.PathLike[str]) -> None:
    """Write the TOML, whole or not at all."""
    tables = experiment.model_dump(mode="json", by_alias=True, exclude_none=True)
    atomic_write(Path(path), with_sum(tomli_w.dumps(tables)))
