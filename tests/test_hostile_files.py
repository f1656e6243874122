"""Files that somebody sends: nothing in them is run, nothing of the machine comes in, none takes for ever."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from smsid.campaign.summary import load_summary
from smsid.cli.file_kind import kind_of
from smsid.description import load_description
from smsid.diagnose.result import load_diagnosis
from smsid.errors import DescriptionError, RecordingError, SmsidError
from smsid.identify.estimate import load_estimate
from smsid.model import build_model
from smsid.recording import Recording, load_recording, save_recording
from smsid.recording.readers import read_columns
from smsid.tracking import load_tracker
from smsid.tracking.json_lines import parse_sample

URDF = """<?xml version="1.0"?>{head}
<robot name="small">{body}<link name="bus"><inertial><mass value="10"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
LAUGHS = (
    "<!DOCTYPE r ["
    + f'<!ENTITY a "{"x" * 50}">'
    + "".join(f'<!ENTITY {chr(98 + i)} "{("&" + chr(97 + i) + ";") * 10}">' for i in range(9))
    + "]>"
)
SECRET = "4711 is the secret"


class Harm:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize("kind", ["entities within entities", "an entity of another file"])
def test_a_urdf_with_entities_is_refused_and_tells_nothing(kind, tmp_path):
    (tmp_path / "secret.txt").write_text(SECRET)
    other = f'<!DOCTYPE r [<!ENTITY e SYSTEM "file://{tmp_path}/secret.txt">]>'
    head, body = (LAUGHS, "&j;") if kind.startswith("entities") else (other, "&e;")
    (tmp_path / "small.urdf").write_text(URDF.format(head=head, body=body))
    with pytest.raises(DescriptionError, match="XML") as caught:
        build_model(load_description(tmp_path / "small.urdf"))
    assert SECRET not in str(caught.value)


def test_pickles_in_archives_are_not_opened(tmp_path):
    mark = tmp_path / "harmed"
    harm = np.empty(1, dtype=object)
    harm[0] = Harm(mark)
    np.savez(tmp_path / "log.npz", t=harm)
    with pytest.raises(RecordingError):
        read_columns(tmp_path / "log.npz")
    (tmp_path / "small.urdf").write_text(URDF.format(head="", body=""))
    array = io.BytesIO()
    np.save(array, harm, allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "tracker.npz", "w") as archive:
        archive.writestr("tracker.json", json.dumps({"schema": "smsid.tracker"}))
        archive.writestr("state.npy", array.getvalue())
    with pytest.raises(RecordingError):
        load_tracker(tmp_path / "tracker.npz", load_description(tmp_path / "small.urdf"))
    assert not mark.exists()


def test_objects_in_a_bags_metadata_are_not_made(tmp_path):
    pytest.importorskip("rosbags")
    bag, mark = tmp_path / "bag", tmp_path / "harmed"
    bag.mkdir()
    (bag / "metadata.yaml").write_text(
        f'rosbag2_bagfile_information: !!python/object/apply:os.system ["touch {mark}"]\n'
    )
    with pytest.raises(RecordingError):
        read_columns(bag)
    assert not mark.exists()


@pytest.mark.parametrize("how", ["external bytes", "external link", "virtual dataset"])
@pytest.mark.parametrize("read", [read_columns, load_recording])
def test_hdf5_that_takes_data_from_other_files_is_refused(how, read, tmp_path):
    (tmp_path / "secret.bin").write_bytes(np.full(8, 4711.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.full(8, 4711.0)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["t"] = np.arange(8.0)
        file["group/again"] = file["t"]
        file["group/loop"] = file["group"]  # groups may hold each other
        if how == "external bytes":
            place = [(str(tmp_path / "secret.bin"), 0, 64)]
            file.create_dataset("group/x", shape=(8,), dtype="f8", external=place)
        elif how == "external link":
            file["group/x"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
        else:
            layout = h5py.VirtualLayout(shape=(8,), dtype="f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", shape=(8,))
            file.create_virtual_dataset("group/x", layout)
    with pytest.raises(RecordingError, match="another file"):
        read(tmp_path / "log.h5")


NESTED = "[" * 100_000 + "]" * 100_000


@pytest.mark.parametrize("read", [kind_of, load_estimate, load_diagnosis, load_summary, parse_sample])
def test_json_that_is_nested_too_deep_is_one_line(read, tmp_path):
    (tmp_path / "deep.json").write_text(NESTED)
    with pytest.raises(SmsidError, match=r"nested too deep|recursion|characters"):
        read(NESTED if read is parse_sample else tmp_path / "deep.json")


def test_json_in_an_archive_or_a_recording_that_is_nested_too_deep_is_one_line(tmp_path):
    (tmp_path / "small.urdf").write_text(URDF.format(head="", body=""))
    with zipfile.ZipFile(tmp_path / "tracker.npz", "w") as archive:
        archive.writestr("tracker.json", NESTED)
    with pytest.raises(RecordingError, match="no saved tracker"):
        load_tracker(tmp_path / "tracker.npz", load_description(tmp_path / "small.urdf"))
    path = save_recording(
        Recording.from_arrays([0.0, 1.0], {"imu.angular_rate": np.zeros((2, 3))}), tmp_path / "r.nc"
    )
    with h5py.File(path, "r+") as file:
        file.attrs["provenance"] = NESTED
    with pytest.raises(RecordingError, match=r"r\.nc|provenance"):
        load_recording(path)
