"""Tables as loggers, spreadsheets and laboratories write them come in with the right numbers."""

# ruff: noqa: E501 - the tables are read by row
from __future__ import annotations

import tomllib

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording import CsvFormat, import_recording, read_columns
from smsid.recording.inspect import inspect_file
from smsid.recording.mapping import parse_mapping

N = 60
T = 0.01 * np.arange(N)
A, B, C = (np.round(np.sin(T * k + k), 6) for k in (1, 2, 3))
RATE = np.cos(T + 1)
SCALE = np.pi / 180


def rows(columns, cell="{}", between=","):
    return "\n".join(between.join(cell.format(x) for x in row) for row in zip(*columns, strict=True)) + "\n"


def german(columns):
    return rows(columns, between=";").replace(".", ",")


def times(form):
    return "time,q1\n" + "\n".join(f"{form(k)},{x}" for k, x in enumerate(A)) + "\n"


PLAIN = "t,q1,q2\n" + rows([T, A, B])
RIGID = ["Format Version,1.23,Take Name,a", "", ",,Type,Body,Body,Body,Body,Body,Body", ",,Name,craft,,,,,",
         ",,ID,77,77,77,77,77,77", ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
         "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z"]  # fmt: skip
MOTIVE = ["Format Version,1.23,Take Name,t1,Frame Rate,100.0,Rotation Type,Quaternion,Space", "", *RIGID[2:]]
LONG = [f"2026-03-01T12:00:{t:06.3f}Z,/SAT/gyro_{axis},{x[k]}" for k, t in enumerate(T)
        for axis, x in zip("xyz", (A, B, C), strict=True) if k % 7 or axis != "z"]  # fmt: skip

ONE, TWO = {"log.joint_position": A[:, None]}, {"log.joint_position": np.column_stack([A, B])}
KINDS = {
    "semicolons, decimal commas, a row of units": ("Zeit;Winkel1;Winkel2\ns;deg;deg\n" + german([T, A, B]), SCALE * TWO["log.joint_position"]),
    "the same under a preamble": ("Messung 7\nDatum;2024-05-01\n\nZeit;Winkel1;Winkel2\n[s];[°];[°]\n" + german([T, A, B]), SCALE * TWO["log.joint_position"]),
    "a first line for the spreadsheet": ("sep=;\nt;q1;q2\n" + german([T, A, B]), TWO),
    "UTF-16": (PLAIN.encode("utf-16"), TWO),
    "UTF-16 without a mark": (PLAIN.encode("utf-16-be"), TWO),
    "Windows-1252": (("t [µs],q1,q2\n" + rows([(1e6 * T).round(), A, B])).encode("cp1252"), TWO),
    "milliseconds as integers": ("time,q1,q2\n" + rows([10 * np.arange(N), A, B]), TWO),
    "quoted decimal commas": ("t,q1,q2\n" + rows([T, A, B], '"{}"', "|").replace(".", ",").replace("|", ","), TWO),
    "aligned by blanks": ("    t      q1     q2\n" + rows([T, A, B], "{:>12}", "  "), TWO),
    "numpy's header in a comment": ("# t q1 q2\n" + rows([T, A, B], between=" "), TWO),
    "comments between samples": (PLAIN.replace("\n0.3,", "\n# event 12\n0.3,"), TWO),
    "a word at the end": (PLAIN + "END OF LOG\n", TWO),
    "newest first": ("t,q1,q2\n" + rows([T[::-1], A[::-1], B[::-1]]), TWO),
    "numbers with units": ("t,q1\n" + rows([T, A], "{} s").replace(" s\n", " rad\n"), ONE),
    "Fortran's exponents": ("t,q1\n" + rows([T, A], "{:.8e}").replace("e", "D"), ONE),
    "a typesetter's minus": ("t,q1,q2\n" + rows([T, A, -B]).replace("-", "\u2212"), {"log.joint_position": np.column_stack([A, -B])}),
    "thousands": ("t_ms,q1\n" + "".join(f'"{5000 + 10 * k:,}",{x}\n' for k, x in enumerate(A)), ONE),
    "lists in cells": ("t,q\n" + "".join(f'{t},"[{a}, {b}]"\n' for t, a, b in zip(T, A, B, strict=True)), TWO),
    "a clock twice": ("Time,q1,Time,q2\n" + rows([T, A, T, B]), TWO),
    "joints of one name": ("t,q,q\n" + rows([T, A, B]), TWO),
    "two rows of names": ("time,joint1,,joint2,\n,pos,vel,pos,vel\n" + rows([T, A, RATE, B, 2 * np.cos(2 * T + 2)]), TWO | {"log.joint_velocity": np.column_stack([RATE, 2 * np.cos(2 * T + 2)])}),
    "motion capture": ("\n".join(RIGID) + "\n" + rows([np.arange(N), T, 0 * T, 0.8 + 0 * T, 0 * T, 0.6 + 0 * T, A, B, C]),
                       {"log.position": np.column_stack([A, B, C]), "log.attitude": np.tile([0, 0.8, 0, 0.6], (N, 1))}),
    "motion capture whose preamble has as many cells": ("\n".join(MOTIVE) + "\n" + rows([np.arange(N), T, 0 * T, 0.8 + 0 * T, 0 * T, 0.6 + 0 * T, A, B, C]),
                       {"log.position": np.column_stack([A, B, C]), "log.attitude": np.tile([0, 0.8, 0, 0.6], (N, 1))}),
    "units behind a stroke": ("t / s;Winkel1 / deg;Winkel2 / deg\n" + german([T, A, B]), SCALE * TWO["log.joint_position"]),
    "units behind a comma": ("Time, ms\tForce X, N\tForce Y, N\tForce Z, N\n" + rows([(1e3 * T).round(), A, B, C], between="\t"), {"log.force": np.column_stack([A, B, C])}),
    "units in words": ("Zeit in s;Position A1 in Grad;Position A2 in Grad\n" + german([T, A, B]), SCALE * TWO["log.joint_position"]),
    "joints by a letter and their unit": ("Time,J1 act (deg),J2 act (deg),J1 torque (Nm),J2 torque (Nm)\n" + rows([T, A, B, B, C]),
                                          {"log.joint_position": SCALE * TWO["log.joint_position"], "log.joint_torque": np.column_stack([B, C])}),
    "a packet's time": ("PACKET,PACKET_TIMESECONDS,RECEIVED_COUNT,Q_1,Q_2,Q_3,Q_S\n" + rows([["ADCS"] * N, (1.7e9 + T).round(3), np.arange(N), 0 * T, 0.8 + 0 * T, 0 * T, 0.6 + 0 * T]),
                        {"log.attitude": np.tile([0, 0.8, 0, 0.6], (N, 1))}),
    "biases beside rates": ("time,omega.x,omega.y,omega.z,gyro_bias.x,gyro_bias.y,gyro_bias.z\n" + rows([T, A, B, C, A, A, A]),
                            {"log.angular_rate": np.column_stack([A, B, C]), "extra.gyro_bias": np.column_stack([A, A, A])}),
    "time, parameter, value": ("Generation Time,Parameter,Value\n" + "\n".join(LONG) + "\n", {"log.joint_position": None}),
    "i, j, k and real": ("t,quat_i,quat_j,quat_k,quat_r\n" + rows([T, 0 * T, 0.8 + 0 * T, 0 * T, 0.6 + 0 * T]),
                         {"log.attitude": np.tile([0, 0.8, 0, 0.6], (N, 1))}),
    "scalar first, then a vector": ("t,q_s,q_v1,q_v2,q_v3\n" + rows([T, 0.6 + 0 * T, 0 * T, 0.8 + 0 * T, 0 * T]),
                                    {"log.attitude": np.tile([0, 0.8, 0, 0.6], (N, 1))}),
    "no header, calendar times": ("".join(f"2024-05-01T10:00:00.{k:02d}Z,{x}\n" for k, x in enumerate(A)), {"extra.column": A}),
    "days of a spreadsheet": (times(lambda k: f"{45413.5 + 0.01 * k / 86400:.11f}"), ONE),
    "days of MATLAB": (times(lambda k: f"{739373.5 + 0.01 * k / 86400:.11f}"), ONE),
    "seconds and microseconds": ("tv_sec,tv_usec,q1\n" + rows([np.full(N, 1_700_000_000), 10_000 * np.arange(N), A]), ONE),
    "month first": (times(lambda k: f"12/31/2023 23:59:59.{50 + k:02d}" if k < 50 else f"01/01/2024 00:00:00.{k - 50:02d}"), ONE),
    "day first": (times(lambda k: f"31/12/2023 23:59:59.{50 + k:02d}" if k < 50 else f"01/01/2024 00:00:00.{k - 50:02d}"), ONE),
    "half days": (times(lambda k: f"5/1/2024 11:59:59.{50 + k:02d} AM" if k < 50 else f"5/1/2024 12:00:00.{k - 50:02d} PM"), ONE),
    "German date and time of day": ("Datum;Uhrzeit;Winkel1\n" + "".join(f"01.05.2024;10:00:00,{k:02d};" + f"{x}\n".replace(".", ",") for k, x in enumerate(A)), ONE),
    "compact ISO": (times(lambda k: f"20240501T100000.{k:02d}Z"), ONE),
    "zone of whole hours": (times(lambda k: f"2024-05-01T10:00:00.{k:02d}+02"), ONE),
    "names of months": (times(lambda k: f"01-May-2024 10:00:00.{k:02d}"), ONE),
    "day of the year with colons": (times(lambda k: f"2024:122:10:00:00.{k:02d}"), ONE),
    "minutes and seconds": (times(lambda k: f"02:00.{k:02d}"), ONE),
    "days since launch": (times(lambda k: f"{3 if k < 30 else 4:03d}/{'23:59:59' if k < 30 else '00:00:00'}.{(70 + k) % 100:02d}").replace("time", "MET"), ONE),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_draft_of_a_table_imports_with_the_right_numbers(kind, tmp_path):
    text, expected = KINDS[kind]
    path = tmp_path / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    report = inspect_file(path)
    found = import_recording(path, parse_mapping(tomllib.loads(report.mapping)))
    for name, values in (
        {"log.joint_position": expected} if isinstance(expected, np.ndarray) else expected
    ).items():
        if values is None:
            continue
        np.testing.assert_allclose(found[name].reshape(values.shape), values, atol=1e-9)
        np.testing.assert_allclose(np.diff(found.time(name)), 0.01, atol=2e-5)
        assert found.time(name).size == N


def test_a_long_table_has_blank_cells_where_a_parameter_has_no_value(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("Generation Time,Parameter,Value\n" + "\n".join(LONG) + "\n")
    columns = read_columns(path)
    np.testing.assert_array_equal(columns["/SAT/gyro_x"], A)
    np.testing.assert_array_equal(columns.missing("/SAT/gyro_z"), np.arange(N) % 7 == 0)
    np.testing.assert_allclose(columns["Generation Time"], T, atol=1e-9)


def test_damaged_columns_do_not_spoil_the_others(tmp_path):
    path = tmp_path / "log.csv"
    cells = ["nan" if k % 10 == 3 else x for k, x in enumerate(B)]
    path.write_text("t,q1,q2\n" + rows([T, A, cells]))
    drafted = inspect_file(path).mapping
    found = import_recording(path, parse_mapping(tomllib.loads(drafted)))
    np.testing.assert_array_equal(found["log.joint_position"][:, 0], A)
    assert '# columns = ["q2"]' in drafted


@pytest.mark.parametrize("word", ["nan", "ERR", "-999.0"])
def test_cells_that_are_stated_to_be_missing_are_no_samples(word, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q1\n" + rows([T, [word if k % 10 == 3 else x for k, x in enumerate(A)]]))
    table = {"columns": ["q1"], "unit": "rad"}
    mapping = {
        "csv": {"missing": [word]},
        "time": {"column": "t", "unit": "s"},
        "channel": {"arm.joint_position": table},
    }
    found = import_recording(path, parse_mapping(mapping))
    kept = np.arange(N) % 10 != 3
    np.testing.assert_array_equal(found["arm.joint_position"][:, 0], A[kept])
    np.testing.assert_allclose(found.time("arm"), T[kept], atol=1e-12)


def test_words_among_numbers_are_told_with_the_mend(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q1,q2\n" + rows([T, A, ["ERR" if k % 10 == 3 else x for k, x in enumerate(B)]]))
    doubts = inspect_file(path).suspicions
    assert any("'q2'" in d and "6 of 60 cells" in d and 'missing = ["ERR"]' in d for d in doubts)


def test_rows_that_are_written_twice_are_named_and_no_rate_is_invented(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q1\n" + rows([np.repeat(T[::2], 2), A]))
    report = inspect_file(path)
    assert "rate" not in report.mapping
    assert any("repeats 30 times" in doubt for doubt in report.suspicions)
    with pytest.raises(RecordingError, match=r"stands still at index 1.*stamps are rounded"):
        import_recording(path, parse_mapping(tomllib.loads(report.mapping)))


def test_points_and_commas_in_one_column_are_told(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t;q1\n0;0,5\n1;0.25\n2;0,125\n")
    assert any("'q1' has points and commas" in doubt for doubt in inspect_file(path).suspicions)


def test_a_blank_as_delimiter_stands_for_any_number_of_them(tmp_path):
    path = tmp_path / "log.dat"
    path.write_text("  1.0   2.0\n 10.0 -20.0\n")
    columns = read_columns(path, CsvFormat(delimiter=" ", names=("t", "x")))
    np.testing.assert_array_equal(columns["x"], [2.0, -20.0])
