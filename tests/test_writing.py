"""Writers lose nothing: full disks, devices, links, killed runs, names that would be paths."""

from __future__ import annotations

import os
import random
import resource
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from smsid._files import atomic_folder, atomic_path, atomic_write, file_stem
from smsid._temporary import PATTERN, remove_orphans, temporary_beside
from smsid.description import load_description
from smsid.errors import OutputError
from smsid.export.folder import export_folder
from smsid.recording import Recording, save_recording

KILLS = 6  # benchmarks/kills.py makes 100, over whole commands
BIG = 200_000
WRITER = """
import sys
from pathlib import Path
from smsid._files import atomic_folder, atomic_write
place = Path(sys.argv[1])
print("ready", flush=True)
while True:
    for letter in "ab":
        atomic_write(place / "file.txt", letter * {big})
        with atomic_folder(place / "folder") as folder:
            (folder / "one").write_text(letter * {big})
            (folder / "two").write_text(letter * {big})
        (place / "folder").rename(place / "gone")
        for name in ("one", "two"):
            (place / "gone" / name).unlink()
        (place / "gone").rmdir()
"""


def test_a_killed_writer_leaves_whole_files_and_the_next_run_tidies_up(tmp_path):
    rng = random.Random(1)
    atomic_write(tmp_path / "file.txt", "a" * BIG)
    for _ in range(KILLS):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER.format(big=BIG), str(tmp_path)], stdout=subprocess.PIPE
        )
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        time.sleep(rng.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.wait()
        text = (tmp_path / "file.txt").read_text()
        assert text in ("a" * BIG, "b" * BIG)
        folder = tmp_path / "folder"
        if folder.exists():
            assert (folder / "one").read_text() == (folder / "two").read_text()
            assert len((folder / "one").read_text()) == BIG
        atomic_write(tmp_path / "other.txt", "next run")
        assert not [p for p in tmp_path.iterdir() if p.name.endswith(".tmp")]
        for name in ("folder", "gone"):
            for file in (tmp_path / name).glob("*"):
                file.unlink()
            if (tmp_path / name).exists():
                (tmp_path / name).rmdir()


def test_what_another_run_is_writing_stays(tmp_path):
    with temporary_beside(tmp_path / "a") as temporary:
        assert PATTERN.fullmatch(temporary.name)
        assert remove_orphans(tmp_path) == [] and temporary.exists()
    mine = tmp_path / ".a.tmp"  # a user's own, not one of ours
    mine.write_text("kept")
    orphan = tmp_path / ".a.smsid-0123456789ab.tmp"
    orphan.write_text("half")
    assert remove_orphans(tmp_path) == [orphan]
    assert mine.read_text() == "kept" and not orphan.exists()


@pytest.mark.parametrize("command", ["import", "simulate", "view", "plot"])
def test_a_full_disk_is_one_line_and_leaves_the_old_file(command, tmp_path, urdf):
    """The limit on a file's size stands for the full disk: a write ends in an error of the system."""
    log = "t,wx,wy,wz\n" + "".join(f"{k / 100},{k % 7},{k % 3},{k % 5}\n" for k in range(2000))
    (tmp_path / "l.csv").write_text(log)
    (tmp_path / "m.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[channel."imu.angular_rate"]\n'
        'columns = ["wx", "wy", "wz"]\nunit = "rad/s"\nframe = "body"\n'
    )
    (tmp_path / "s.toml").write_text(
        'schema = 1\nname = "s"\nduration = 2.0\n[force]\nkind = "constant"\nvalue = [1.0, 0.0, 0.0]\n'
    )
    description = str(urdf / "paper_sms.toml")
    words, out = {
        "import": (["import", "l.csv", "--map", "m.toml", "--unchecked"], "o.nc"),
        "simulate": (["simulate", description, "s.toml"], "o.nc"),
        "view": (["view", description], "o.html"),
        "plot": (["plot", "recording", "r.nc"], "o.pdf"),
    }[command]
    rates = {"imu.angular_rate": np.random.default_rng(1).normal(size=(2000, 3))}
    save_recording(Recording.from_arrays(0.01 * np.arange(2000), rates), tmp_path / "r.nc")
    (tmp_path / out).write_text("old")
    before = sorted(p.name for p in tmp_path.iterdir())
    done = subprocess.run(
        [sys.executable, "-c", "from smsid.cli import main; main()", *words, "-o", out, "-q"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},  # cut off, compiled modules would stay so
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)),
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "the disk is full" in done.stderr, done.stderr
    assert (tmp_path / out).read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_devices_pipes_and_loops_are_refused_and_links_followed(tmp_path):
    pipe, loop, link = tmp_path / "pipe", tmp_path / "loop", tmp_path / "link"
    os.mkfifo(pipe)
    loop.symlink_to(loop)
    for path in (pipe, loop, Path("/dev/null"), tmp_path / ("x" * 300), tmp_path / "a\x00b"):
        with pytest.raises(OutputError, match="Cannot write"):
            atomic_write(path, "lost")
    assert stat.S_ISFIFO(pipe.stat().st_mode) and loop.is_symlink()
    (tmp_path / "target").write_text("old")
    (tmp_path / "target").chmod(0o640)
    link.symlink_to("target")
    atomic_write(link, "new")
    assert link.is_symlink() and (tmp_path / "target").read_text() == "new"
    assert stat.S_IMODE((tmp_path / "target").stat().st_mode) == 0o640


def test_a_name_as_long_as_a_name_may_be_is_written(tmp_path):
    path = tmp_path / ("\u00fc" * 127)
    atomic_write(path, "whole")
    assert path.read_text() == "whole" and len(list(tmp_path.iterdir())) == 1


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    with pytest.raises(ZeroDivisionError), atomic_folder(tmp_path / "there") as folder:
        (folder / "a").write_text("half")
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())
    with pytest.raises(OutputError, match="Nothing was written"), atomic_path(tmp_path / "none"):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name",
    [
        *(
            "../../up",
            "a/b",
            "a\\b",
            "..",
            ".hidden",
            "",
            " a",
            "a ",
            "a\x00b",
            "a\nb",
            "con",
            "NUL",
            "com1.x",
        ),
        *("com1.x", "x" * 300, "-o", "a:b", "a*", "\u202ea", "end."),
    ],
)
def test_a_name_never_becomes_a_path(name):
    with pytest.raises(OutputError, match="and a file is to be called by it"):
        file_stem(name)


@pytest.mark.parametrize("name", ["small", "paper_sms", "a.b", "\u00fcn\u00ef", "panda 2", "console"])
def test_a_sound_name_is_kept(name):
    assert file_stem(name) == name


def test_export_stays_in_its_folder(tmp_path, urdf):
    description = load_description(urdf / "paper_sms.toml")
    (tmp_path / "a" / "b").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(OutputError, match=r"'\.\./\.\./up'"):
        export_folder(description.model_copy(update={"name": "../../up"}), tmp_path / "a" / "b" / "ex")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_file_in_a_folder_that_cannot_be_written_is_told_by_the_folders_name(tmp_path):
    with pytest.raises(OutputError, match="disk is full") as caught, atomic_folder(tmp_path / "made") as made:
        (made / "one").write_text("1")
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
        try:
            atomic_write(made / "two", "x" * 4000)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
            signal.signal(signal.SIGXFSZ, old)
    assert f"'{tmp_path / 'made' / 'two'}'" in str(caught.value) and ".tmp" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
