from __future__ import annotations

import os
import stat

import pytest

from smsid._files import atomic_path, atomic_write
from smsid.errors import SmsidError


def test_text_and_bytes_arrive_as_they_are(tmp_path):
    text, data = "line\r\nmu µ\n", b"\x00\xff\r\n"
    assert atomic_write(tmp_path / "a.txt", text).read_bytes() == text.encode()
    assert atomic_write(tmp_path / "b.bin", data).read_bytes() == data
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "b.bin"]


def test_an_error_keeps_the_old_file_and_removes_the_temporary_one(tmp_path):
    path = atomic_write(tmp_path / "a.txt", "old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_the_new_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "plain").write_text("")
    path = atomic_write(tmp_path / "a.txt", "new")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_a_symbolic_link_stays_one(tmp_path):
    target = tmp_path / "target.txt"
    target.write_text("old")
    link = tmp_path / "link.txt"
    link.symlink_to(target)
    atomic_write(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_missing_folder_folder_and_nothing_written_are_refused(tmp_path):
    with pytest.raises(SmsidError, match="does not exist"):
        atomic_write(tmp_path / "gone" / "a.txt", "x")
    with pytest.raises(SmsidError, match="is a folder"):
        atomic_write(tmp_path, "x")
    with pytest.raises(SmsidError, match="Nothing was written"), atomic_path(tmp_path / "a.txt"):
        pass
