"""Panels from finite elements, against a cantilever assembled here and its formulas."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.linalg import eigh

from smsid.description import load_description
from smsid.errors import DescriptionError, MissingDependencyError

LENGTH, DENSITY, STIFFNESS, ELEMENTS = 4.0, 3.0, 200.0, 16  # [m], [kg/m], EI [N m^2]
BUS = """<robot name="b"><link name="bus"><inertial><mass value="100"/>
<inertia ixx="20" iyy="30" izz="40" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def cantilever(count):
    """Return eigenvalues, shapes and root reactions (T3, R2) of a beam along x that bends in z, and L."""
    h = LENGTH / ELEMENTS
    k = STIFFNESS / h**3 * np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
    )  # fmt: skip
    m = DENSITY * h / 420 * np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
    )  # fmt: skip
    n = 2 * ELEMENTS + 2
    stiff, mass = np.zeros((n, n)), np.zeros((n, n))
    for e in range(ELEMENTS):
        own = slice(2 * e, 2 * e + 4)
        stiff[own, own] += k
        mass[own, own] += m
    values, vectors = eigh(stiff[2:, 2:], mass[2:, 2:])
    shapes = np.vstack([np.zeros((2, n - 2)), vectors])[:, :count]
    values = values[:count]
    reaction = (stiff @ shapes - mass @ shapes * values)[:2]
    up, turn = (
        np.tile([1.0, 0.0], ELEMENTS + 1),
        np.ravel([[LENGTH * j / ELEMENTS, 1.0] for j in range(ELEMENTS + 1)]),
    )
    return values, shapes, reaction, up @ mass @ shapes, turn @ mass @ shapes


def node(shape, j):
    # the slope dz/dx is a rotation about -y
    return np.array([0, 0, shape[2 * j], 0, -shape[2 * j + 1], 0])


def tables(count=3, scale=1.0):
    """Yield mode, eigenvalue, motion and constraint forces by node, of modes with a generalised mass."""
    values, shapes, reaction, *_ = cantilever(count)
    for k in range(count):
        motion = {j + 1: scale * node(shapes[:, k], j) for j in range(ELEMENTS + 1)}
        force = scale * np.array([0, 0, reaction[0, k], 0, -reaction[1, k], 0])
        yield k + 1, values[k], motion, {1: force}


def f06(scale):
    mass = DENSITY * LENGTH
    first, second = mass * LENGTH / 2, mass * LENGTH**2 / 3
    mo = np.diag([mass, mass, mass, 0.0, second, second])
    mo[2, 4] = mo[4, 2] = -first
    mo[1, 5] = mo[5, 1] = first
    out = ["     O U T P U T   F R O M   G R I D   P O I N T   W E I G H T   G E N E R A T O R", "  M O"]
    out += ["   * " + " ".join(f"{x:13.6E}" for x in row) + " *" for row in mo]
    out.append("      R E A L   E I G E N V A L U E S")
    out.append("   MODE    EXTRACTION      EIGENVALUE   RADIANS   CYCLES   GENERALIZED   GENERALIZED")
    modes = list(tables(scale=scale))
    for k, value, *_ in modes:
        w = np.sqrt(value)
        row = (value, w, w / 2 / np.pi, scale**2, scale**2 * value)
        out.append(f"  {k:8d}  {k:8d}   " + "   ".join(f"{x:13.6E}" for x in row))
    vector = "R E A L   E I G E N V E C T O R   N O .          {}"
    force = "F O R C E S   O F   S I N G L E - P O I N T   C O N S T R A I N T"
    for title, index in ((vector, 2), (force, 3)):
        for mode in modes:
            out.append(f"      EIGENVALUE = {mode[1]:13.6E}")
            out.append(f"          CYCLES =  0.0      {title.format(mode[0])}")
            out.append("      POINT ID.   TYPE          T1             T2             T3        R1   R2   R3")
            for n, row in mode[index].items():
                out.append(f"{n:14d}      G   " + "  ".join(f"{x:13.6E}" for x in row))
    return "\n".join(out)


def punch():
    out, count = [], 0
    for title, index in (("$EIGENVECTORS", 2), ("$SPCF", 3)):
        for mode in tables():
            for text in (
                "$TITLE   = PANEL",
                title,
                "$REAL OUTPUT",
                f"$EIGENVALUE = {mode[1]:14.7E}  MODE = {mode[0]:5d}",
            ):
                count += 1
                out.append(f"{text:<72}{count:8d}")
            for n, row in mode[index].items():
                first = f"{n:10d}       G" + "".join(f"{x:18.6E}" for x in row[:3])
                out.append(f"{first:<72}{count + 1:8d}")
                second = "-CONT-            " + "".join(f"{x:18.6E}" for x in row[3:])
                out.append(f"{second:<72}{count + 2:8d}")
                count += 2
    return "\n".join(out)


def _printed(x):
    return np.vectorize(lambda one: float(f"{one:13.6E}"))(x)


RIGID = """mass = 12.0
center_of_mass = [2.0, 0.0, 0.0]
inertia = [0.0, 0.0, 64.0, 0.0, 0.0, 64.0]
"""


def described(folder, name, more="", rigid=RIGID):
    (folder / "b.urdf").write_text(BUS)
    (folder / "b.toml").write_text(
        f'schema = 1\nname = "b"\nurdf = "b.urdf"\n[[effect]]\nkind = "modal_appendage"\nname = "panel"\n'
        f"position = [0.0, 0.0, 0.0]\nstations = [[4.0, 0.0, 0.0]]\n{rigid}"
        f'finite_elements = {{ file = "{name}"{more} }}\n'
    )
    return load_description(folder / "b.toml").get_effect("panel")


def check(panel, tolerance):
    values, shapes, _, lt, lr = cantilever(3)
    assert len(panel.mode) == 3
    for k, mode in enumerate(panel.mode):
        assert mode.frequency == pytest.approx(np.sqrt(values[k]) / 2 / np.pi, rel=tolerance)
        size = np.abs(lt[k])
        assert mode.translation == pytest.approx([0, 0, lt[k]], abs=tolerance * size)
        assert mode.rotation == pytest.approx([0, -lr[k], 0], abs=tolerance * abs(lr).max())
        assert mode.shape[0] == pytest.approx([0, 0, shapes[2 * ELEMENTS, k]], rel=tolerance)
        assert mode.damping == 0.005


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_an_f06_with_its_weights(scale, tmp_path):
    (tmp_path / "p.f06").write_text(f06(scale))
    panel = described(tmp_path, "p.f06", f", root = 1, nodes = [{ELEMENTS + 1}], damping = 0.005", rigid="")
    check(panel, 3e-6)  # seven digits are printed
    for mode, (_, value, _, force) in zip(panel.mode, tables(), strict=True):  # by hand, with those digits
        value, pull, mass = (_printed(x) for x in (value, scale * force[1], scale**2))
        assert mode.frequency == pytest.approx(np.sqrt(value) / 2 / np.pi, rel=1e-12)
        assert mode.translation == pytest.approx(-pull[:3] / value / np.sqrt(mass), abs=1e-12)
        assert mode.rotation == pytest.approx(-pull[3:] / value / np.sqrt(mass), abs=1e-12)
    assert panel.mass == 12.0 and panel.center_of_mass == (2.0, 0.0, 0.0)
    assert panel.inertia == (0.0, 0.0, 64.0, 0.0, 0.0, 64.0)
    first = np.sqrt(STIFFNESS / DENSITY) * (1.8751040687 / LENGTH) ** 2 / 2 / np.pi
    assert panel.mode[0].frequency == pytest.approx(first, rel=1e-5)  # the beam's own formula


def test_a_punch_file(tmp_path):
    (tmp_path / "p.pch").write_text(punch())
    check(described(tmp_path, "p.pch", f", root = 1, nodes = [{ELEMENTS + 1}], damping = 0.005"), 3e-6)


def test_plain_tables_are_the_modes_by_hand_to_the_last_digit(tmp_path):
    values, shapes, _, lt, lr = cantilever(3)
    frequency = np.sqrt(values) / 2 / np.pi
    rows = ["frequency,damping,tx,ty,tz,rx,ry,rz,s1x,s1y,s1z"]
    modes = []
    for k in range(3):
        tip = shapes[2 * ELEMENTS, k]
        rows.append(
            ",".join(repr(float(x)) for x in (frequency[k], 0.005, 0, 0, lt[k], 0, -lr[k], 0, 0, 0, tip))
        )
        modes.append({"frequency": frequency[k], "damping": 0.005, "translation": [0, 0, lt[k]],
                      "rotation": [0, -lr[k], 0], "shape": [[0, 0, tip]]})  # fmt: skip
    (tmp_path / "p.csv").write_text("\n".join(rows))
    (tmp_path / "p.json").write_text(json.dumps({"mode": modes}))
    check(described(tmp_path, "p.csv"), 1e-12)
    check(described(tmp_path, "p.json"), 1e-12)


def test_what_is_missing_is_named(tmp_path):
    (tmp_path / "p.f06").write_text(f06(1.0))
    with pytest.raises(DescriptionError, match="damping"):
        described(tmp_path, "p.f06", ", root = 1, nodes = [17]")
    with pytest.raises(DescriptionError, match="node 99"):
        described(tmp_path, "p.f06", ", nodes = [99], damping = 0.01")
    with pytest.raises(DescriptionError, match=r"rood: unknown key \(did you mean 'root'"):
        described(tmp_path, "p.f06", ", rood = 1")
    (tmp_path / "q.f06").write_text(f06(1.0).split("F O R C E S")[0])
    with pytest.raises(DescriptionError, match="SPCFORCES"):
        described(tmp_path, "q.f06", ", nodes = [17], damping = 0.01")


@pytest.fixture
def old_names(monkeypatch):
    """Give numpy the name back that pyNastran 1.4 takes and numpy 2.4 has no longer: users get numpy 2.3."""
    monkeypatch.setattr(np, "in1d", np.isin, raising=False)


def written_op2(path):
    """Write the modes with pyNastran: an OP2 of four-byte numbers, as Nastran's own by default."""
    op2 = pytest.importorskip(
        "pyNastran.op2.op2_geom", reason="pyNastran does not load", exc_type=(ImportError, AttributeError)
    )
    from pyNastran.op2.tables.oqg_constraintForces.oqg_spc_forces import RealSPCForcesArray
    from pyNastran.op2.tables.oug.oug_eigenvectors import RealEigenvectorArray

    modes = list(tables())
    numbers, values = [int(m[0]) for m in modes], np.array([m[1] for m in modes])
    model = op2.OP2Geom(debug=False)
    for kind, table, code, index, into in (
        (RealEigenvectorArray, "OUGV1", 7, 2, model.eigenvectors),
        (RealSPCForcesArray, "OQG1", 3, 3, model.spc_forces),
    ):
        nodes = np.array([(n, 1) for n in modes[0][index]])
        data = np.array([list(m[index].values()) for m in modes], dtype="float32")
        cycles = np.sqrt(values) / 2 / np.pi
        into[1] = kind.add_modal_case(table, nodes, data, 1, numbers, values, cycles)
        into[1].table_code = into[1].data_code["table_code"] = code
    model.write_op2(str(path), nastran_format="msc")


@pytest.mark.usefixtures("old_names")
def test_an_op2(tmp_path, caplog):
    written_op2(tmp_path / "p.op2")
    panel = described(tmp_path, "p.op2", f", root = 1, nodes = [{ELEMENTS + 1}], damping = 0.005")
    assert "no table of eigenvalues" in caplog.text  # pyNastran writes none
    check(panel, 2e-7)  # 24 bits are written
    for mode, (_, value, motion, force) in zip(panel.mode, tables(), strict=True):
        value, tip, pull = (np.float32(x).astype(float) for x in (value, motion[ELEMENTS + 1][:3], force[1]))
        assert mode.frequency == pytest.approx(np.sqrt(value) / 2 / np.pi, rel=1e-12)
        assert mode.translation == pytest.approx(-pull[:3] / value, abs=1e-12)
        assert mode.rotation == pytest.approx(-pull[3:] / value, abs=1e-12)
        assert mode.shape[0] == pytest.approx(tip, rel=1e-12)


def test_an_op2_without_pynastran_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyNastran.op2.op2", None)
    (tmp_path / "p.op2").write_bytes(b"")
    with pytest.raises(MissingDependencyError, match=r"smsid\[nastran\]"):
        described(tmp_path, "p.op2", ", damping = 0.01")
