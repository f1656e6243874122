"""A grasped body's ten parameters are found from a flight of a world that smsid knows nothing of."""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from smsid.effects import GraspedBody
from smsid.estimation.identify_flights import identify_flights
from tests.estimation.satellite import Satellite, burns_and_wheels, guess, recorded

BEFORE = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
BODY = pin.Inertia(40.0, np.array([0.8, -0.4, 0.3]), np.diag([3.0, 4.0, 2.5]))


def test_all_ten_parameters_are_found(tmp_path):
    plain = pin.Inertia.FromDynamicParameters(_parameters(BEFORE))
    whole = plain + BODY
    about = whole.inertia - whole.mass * pin.skew(whole.lever) @ pin.skew(whole.lever)
    after = replace(BEFORE, mass=whole.mass, centre=tuple(whole.lever), inertia=tuple(map(tuple, about)))
    described = guess(tmp_path, BEFORE, off=0.0, tank=False, panel=False)
    _write_truth(tmp_path, plain)
    start = GraspedBody.model_validate(
        {
            "name": "target",
            "mass": 25.0,
            "centre": (0.5, 0.0, 0.0),
            "central_inertia": (2, 0, 2, 0, 0, 2),
        }
    )
    recording = recorded(after, after.fly(72.0, burns_and_wheels), np.random.default_rng(5), every=10)
    found = identify_flights(described.with_effects(start), [recording], bodies=False)
    true = GraspedBody.model_validate(
        {
            "name": "target",
            "mass": BODY.mass,
            "centre": tuple(BODY.lever),
            "central_inertia": tuple(BODY.toDynamicParameters()[4:] - _shift(BODY)),
        }
    )
    off = {
        p.name: (found.estimate[p.name].value - p.value) / found.estimate[p.name].sigma
        for p in true.parameters()
    }
    assert len(off) == 10
    assert max(map(abs, off.values())) < 3.5
    assert found.estimate["target.mass"].relative_sigma < 0.02
    assert found.estimate["target.mass"].status == "identifiable"


def _parameters(satellite):
    j = np.array(satellite.inertia)
    c = satellite.mass * np.array(satellite.centre)
    return np.array([satellite.mass, *c, j[0, 0], j[0, 1], j[1, 1], j[0, 2], j[1, 2], j[2, 2]])


def _shift(body):
    central = pin.Inertia(body.mass, np.zeros(3), body.inertia).toDynamicParameters()[4:]
    return body.toDynamicParameters()[4:] - central


def _write_truth(folder, body):
    """Put the satellite before into the URDF exactly: the description's bus is known."""
    x, y, z = body.lever
    i = body.inertia
    (folder / "satellite.urdf").write_text(
        f'<robot name="satellite"><link name="bus"><inertial><origin xyz="{x} {y} {z}"/>'
        f'<mass value="{body.mass}"/><inertia ixx="{i[0, 0]}" iyy="{i[1, 1]}" izz="{i[2, 2]}" '
        f'ixy="{i[0, 1]}" ixz="{i[0, 2]}" iyz="{i[1, 2]}"/></inertial></link></robot>',
        encoding="utf-8",
    )
