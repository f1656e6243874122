"""Panels that ring nearly alike: both ways round are said, and a pair far apart is not asked about."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from smsid.description.schema import Description, Thruster
from smsid.effects import ModalAppendage, ThrusterGain
from smsid.effects.appendage import Mode
from smsid.estimation._exchange import _exchanged, _near, _pairs, distinct, likely_exchanges
from smsid.estimation._normal_equations import normal_equations
from smsid.estimation.flight import FlightOptions, flight_of
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.parameter_vector import Point
from smsid.estimation.unknowns import unknowns_of
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.sensing.error_model import ErrorModel

URDF = """<robot name="pair"><link name="bus"><inertial><origin xyz="0 0 0"/><mass value="400"/>
<inertia ixx="300" iyy="500" izz="300" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
INERTIA = 300.0 + 2.0 * 140.0
PANELS = {"north": (0.182, 0.004, 11.2), "south": (0.195, 0.005, -10.4)}


def turned(seconds=70.0, rate=4.0):
    """Return the recording of a turn about one axis.

    Panels and bus are a linear system there: J w' + sum L e'' = T, e'' + 2 z o e' + o^2 e = -L w'.
    """
    o, z, rows = (np.array(x) for x in zip(*PANELS.values(), strict=True))
    o = 2.0 * np.pi * o
    mass = np.block([[np.array([[INERTIA]]), rows[None]], [rows[:, None], np.eye(2)]])

    def torque(t):
        return np.select([t < 10.0, t < 18.0, t < 26.0], [0.0, 4.0, -4.0], 0.0)

    def derivative(t, x):
        force = np.concatenate([[torque(t)], -2.0 * z * o * x[4:] - o**2 * x[1:3]])
        return np.concatenate([x[3:], np.linalg.solve(mass, force)])

    times = np.arange(round(seconds * rate) + 1) / rate
    found = solve_ivp(
        derivative, (0.0, seconds), np.zeros(6), t_eval=times, rtol=1e-8, atol=1e-12, max_step=0.1
    )
    rng = np.random.default_rng(1)
    turn, w = rng.normal(0.0, 2e-5, (len(times), 3)), np.zeros((len(times), 3))
    turn[:, 0] += found.y[0]
    w[:, 0] = found.y[3]
    channels = {
        "st.attitude": Rotation.from_rotvec(turn).as_quat(),
        "gyro.angular_rate": w + rng.normal(0.0, 1e-5, w.shape),
        "command.torque": np.column_stack([torque(times), np.zeros((len(times), 2))]),
    }
    return Recording.from_arrays(times, channels, name="turned")


def _mode(frequency, row):
    return Mode(frequency=frequency, damping=0.006, translation=(0.0, 0.0, 0.0), rotation=(row, 0.0, 0.0))


def _noise(quantity, sigma):
    return {quantity: ErrorModel(noise_sigma=sigma)}


def described(folder, frequencies):
    (folder / "pair.urdf").write_text(URDF, encoding="utf-8")
    panels = [
        ModalAppendage(
            name=name,
            position=(0.0, 0.0, 0.0),
            mass=17.0,
            center_of_mass=(0.0, 0.0, 0.0),
            inertia=(140.0, 0.0, 4.0, 0.0, 0.0, 140.0),
            mode=(_mode(f, 9.0 * np.sign(PANELS[name][2])),),
        )
        for name, f in zip(PANELS, frequencies, strict=True)
    ]
    gyro = Sensor(
        name="gyro", kind="imu", quantities=("angular_rate",), rate=4.0, errors=_noise("angular_rate", 1e-5)
    )
    tracker = Sensor(
        name="st", kind="pose", quantities=("attitude",), rate=4.0, errors=_noise("attitude", 2e-5)
    )
    return Description.model_validate(
        {
            "schema": 1,
            "name": "pair",
            "urdf": "pair.urdf",
            "folder": folder,
            "effect": panels,
            "sensor": (gyro, tracker),
        }
    )


def test_panels_about_one_axis_may_be_the_other_way_round_and_intervals_say_so(tmp_path):
    found = identify_flights(described(tmp_path, (0.2, 0.18)), [turned()], bodies=False)
    assert any("'north' and 'south' may be the other way round" in n for n in found.estimate.notes)
    for name, (frequency, _, row) in PANELS.items():
        for parameter, truth in ((f"{name}.mode1.frequency", frequency), (f"{name}.mode1.rotation.x", row)):
            low, high = found.estimate[parameter].interval
            assert low < truth < high
    low, high = found.estimate["north.mode1.frequency"].interval
    assert low < 0.182 and high > 0.195 and high - low < 0.02


def test_an_exchange_keeps_signs_and_pairs_far_apart_are_not_asked(tmp_path):
    for frequencies, near in (((0.18, 0.2), True), ((0.18, 0.4), False)):
        point = Point.of(described(tmp_path, frequencies))
        flight = flight_of(point, turned(20.0), "turned", FlightOptions())
        unknowns = unknowns_of(point, bodies=False).unknowns
        step = _exchanged(point, unknowns, ("north", "south"))
        moved = {u.name: point.value(u) + d for u, d in zip(unknowns, step, strict=True)}
        assert moved["north.mode1.frequency"] == frequencies[1]
        assert moved["north.mode1.rotation.x"] == 9.0 and moved["south.mode1.rotation.x"] == -9.0
        found = normal_equations(point, unknowns, [flight])
        assert _near(found, step) is near
        there: Any = SimpleNamespace(point=point.moved(unknowns, step))
        assert distinct(found, [(("north", "south"), found), (("south", "north"), there)]) == [
            (("south", "north"), there)
        ]


def test_only_what_rings_on_the_same_body_is_asked(tmp_path):
    """Gains of thrusters and frictions of joints have names that what was commanded or read tells apart."""
    description = described(tmp_path, (0.18, 0.2))
    gains = [ThrusterGain(name=f"g{k}", thruster=f"t{k}", gain=0.1) for k in (1, 2)]
    thrusters = [Thruster(name=f"t{k}", position=(k, 0, 0), direction=(0, 1, 0), force=1.0) for k in (1, 2)]
    effects = (*description.effect, *gains)
    point = Point.of(description.model_copy(update={"effect": effects, "thruster": tuple(thrusters)}))
    unknowns = tuple(unknowns_of(point).unknowns)
    assert {u.name.partition(".")[0] for u in unknowns} > {"g1", "g2", "north", "south"}
    found: Any = SimpleNamespace(point=point, unknowns=unknowns)
    assert _pairs(found) == [("north", "south")]


def test_probabilities_are_shared_by_all_maxima_and_know_of_widening():
    here, *there = (cast(Any, SimpleNamespace(objective=x)) for x in (5.0, 5.0, 6.0, 14.0))
    others = [((f"a{k}", f"b{k}"), x) for k, x in enumerate(there)]
    whole = 2.0 + np.exp(-1.0) + np.exp(-9.0)
    first, second = likely_exchanges(here, others, 1.0)
    assert first.probability == pytest.approx(1.0 / whole)
    assert second.probability == pytest.approx(np.exp(-1.0) / whole)
    assert "a0' and 'b0' may be the other way round" in first.note
    assert len(likely_exchanges(here, others, 3.0)) == 3
