"""A panel that rests bent: as a beam of constant curvature, of which each mode has its share."""

import numpy as np
import pytest
from scipy.integrate import quad

from smsid.description import Description
from smsid.effects import BeamAppendage, ModalAppendage, ThermalSnap
from smsid.errors import DescriptionError
from smsid.model import build_model
from smsid.paths import urdf_folder
from tests.effects.test_catalogue import example

TIP = 0.02
PANEL = BeamAppendage(
    name="panel", position=(1.0, 0.0, 0.0), length=2.0, width=1.0, thickness=0.002, density=2700.0,
    youngs_modulus=7e10, damping=0.005, stations=(0.0, 2.0),
)  # fmt: skip


def built(*effects):
    return build_model(
        Description(name="x", urdf="paper_sms.urdf", folder=urdf_folder()).with_effects(*effects)
    )


def test_modes_rest_where_a_beam_of_constant_curvature_has_them():
    model = built(PANEL, ThermalSnap(name="s", appendage="panel", deflection=TIP, start=5.0))
    forces = [model.passive_forces(t, model.home, np.zeros(model.nv)) for t in (4.9, 5.0)]
    assert not forces[0].any()
    index = model.modes.v
    assert not np.delete(forces[1], index).any()
    (panel,) = model.appendages
    omega = 2.0 * np.pi * np.array([m.frequency for m in PANEL.modal_data()])
    rest = forces[1][index] / panel.scale / omega**2
    shape, mass = PANEL.cantilever.shape, PANEL.mass
    wanted = [
        quad(lambda x, k=k: TIP * (x / 2.0) ** 2 * shape(x)[k] * mass / 2.0 / np.sqrt(mass), 0.0, 2.0)[0]
        for k in range(len(omega))
    ]
    assert rest == pytest.approx(wanted, rel=1e-6)
    assert rest @ (shape(2.0) / np.sqrt(mass)) == pytest.approx(TIP, rel=0.05)


def test_a_panel_of_modal_data_is_refused():
    sail = example("modal_appendage")
    assert isinstance(sail, ModalAppendage)
    with pytest.raises(DescriptionError, match="no beam_appendage"):
        built(sail, ThermalSnap(name="s", appendage="sail", deflection=TIP))
