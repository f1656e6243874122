"""Telemetry on the standard input, from a file that grows, and a recording played into it."""

import json
import threading
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.description import load_description, save_description
from smsid.errors import RecordingError
from smsid.recording import Recording, load_recording, save_recording
from smsid.tracking import load_tracker
from smsid.tracking.json_lines import lines_of

from .craft import INERTIA, craft, flight


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("stream")
    save_description(craft(found), found / "craft.toml")
    save_recording(flight(6.0), found / "flight.nc")
    return found


def play(path, *options):
    run = CliRunner().invoke(app, ["play", str(path), *options], catch_exceptions=False)
    assert run.exit_code == 0
    return run.stdout


def stream(folder, *words, lines=""):
    words = ["stream", str(folder / "craft.toml"), *words, "--follow", "bus.I*=0", "--begin", "2"]
    run = CliRunner().invoke(app, words, input=lines, catch_exceptions=False)
    return run, [json.loads(x) for x in run.stdout.splitlines()]


def results(told):
    return [x for x in told if "parameters" in x]


def test_a_played_recording_is_followed(folder):
    lines = play(folder / "flight.nc")
    assert json.loads(lines.splitlines()[0]) == {"labels": {"wheel": ["rw1", "rw2", "rw3"]}}
    run, told = stream(folder, "--save", str(folder / "state.npz"), lines=lines)
    assert run.exit_code == 0
    found = results(told)
    assert [round(x["time"], 6) for x in found] == [2, 3, 4, 5, 6]
    assert list(found[-1]["parameters"]) == INERTIA
    assert found[-1]["sigmas"]["bus.Izz"] < 0.5 * found[0]["sigmas"]["bus.Izz"]
    tracker = load_tracker(folder / "state.npz", load_description(folder / "craft.toml"))
    np.testing.assert_array_equal(tracker.values, list(found[-1]["parameters"].values()))


def test_samples_out_of_order_are_waited_for_if_asked(folder):
    head, *lines = play(folder / "flight.nc").splitlines(keepends=True)
    for k in range(0, len(lines) - 1, 2):
        lines[k : k + 2] = lines[k + 1], lines[k]
    mixed = "".join([head, *lines])
    _, ordered = stream(folder, lines=play(folder / "flight.nc"))
    _, named = stream(folder, lines=mixed)
    assert [x for x in named if x.get("event") == "late"]
    _, waited = stream(folder, "--lateness", "0.25", lines=mixed)
    assert not [x for x in waited if "event" in x]
    ends, end = results(ordered)[-1], results(waited)[-1]
    for name, value in ends["parameters"].items():  # begun by a little less, linear elsewhere
        assert abs(end["parameters"][name] - value) < 0.01 * ends["sigmas"][name]


def test_columns_go_by_their_labels(folder):
    """Wheels in another order tell the same."""
    one = load_recording(folder / "flight.nc")
    turned = {c: one[c][:, ::-1] if "wheel" in c else one[c] for c in one.channels}
    other = Recording.from_arrays(one.time(), turned, labels={"wheel": ("rw3", "rw2", "rw1")})
    save_recording(other, folder / "turned.nc")
    straight, crossed = (
        results(stream(folder, lines=play(folder / f))[1]) for f in ("flight.nc", "turned.nc")
    )
    assert crossed == straight
    unknown = json.dumps({"labels": {"wheel": ["a", "b", "c"]}}) + "\n"
    with pytest.raises(RecordingError, match=r"No sample came\..*rw1"):
        stream(folder, lines=unknown + play(folder / "flight.nc").partition("\n")[2])


def test_a_stream_is_stopped_and_gone_on_with(folder):
    lines = play(folder / "flight.nc").splitlines(keepends=True)
    whole = results(stream(folder, lines="".join(lines))[1])
    state = str(folder / "half.npz")
    stream(folder, "--save", state, lines="".join(lines[:31]))
    words = ["stream", str(folder / "craft.toml"), "--restore", state]
    run = CliRunner().invoke(app, words, input="".join([lines[0], *lines[31:]]), catch_exceptions=False)
    last = json.loads(run.stdout.splitlines()[-1])
    for name, value in whole[-1]["parameters"].items():
        assert last["parameters"][name] == pytest.approx(value, rel=1e-6)
    run = CliRunner().invoke(app, [*words, "--hold", "bus.Ixx"])
    assert run.exit_code != 0


def test_a_file_that_grows_is_followed_until_it_is_quiet(folder):
    lines = play(folder / "flight.nc").splitlines(keepends=True)
    path = folder / "growing.jsonl"
    path.write_text("".join(lines[:20]), encoding="utf-8")

    def write():
        time.sleep(0.3)
        with path.open("a", encoding="utf-8") as file:
            file.writelines(lines[20:])

    writer = threading.Thread(target=write)
    writer.start()
    _, told = stream(folder, str(path), "--wait", "2")
    writer.join()
    assert results(told)[-1]["time"] == pytest.approx(6.0)
    with pytest.raises(RecordingError, match="Cannot read"):
        stream(folder, str(folder / "none.jsonl"))


def test_a_recording_is_played_at_its_pace(folder):
    begun = time.monotonic()
    play(folder / "flight.nc", "--speed", "20")
    assert time.monotonic() - begun > 0.29  # six seconds twenty times as fast


def test_what_cannot_be_read_is_told_and_the_stream_goes_on(folder):
    lines = play(folder / "flight.nc").splitlines(keepends=True)
    lines[5:5] = ["[1, 2]\n", '{"labels": 3}\n', '{"time": 0.45, "gyro.angular_rate": ["a"]}\n']
    run, told = stream(folder, lines="".join(lines))
    assert run.exit_code == 0
    assert [x["line"] for x in told if x.get("event") == "rejected"] == [6, 7, 8]
    assert not [x for x in told if x.get("event") not in (None, "rejected")]
    assert results(told)[-1]["time"] == pytest.approx(6.0)


@pytest.mark.parametrize("line", [1, 15, 45])
def test_a_wrong_time_is_told_and_the_stream_goes_on(folder, line):
    """At the first sample, in the beginning that is looked at first, and later."""
    lines = play(folder / "flight.nc").splitlines(keepends=True)
    wrong = json.loads(lines[line]) | {"time": 1e12}
    run, told = stream(folder, lines="".join([*lines[:line], json.dumps(wrong) + "\n", *lines[line + 1 :]]))
    assert run.exit_code == 0
    assert {x["time"] for x in told if x.get("event") == "ahead"} == {1e12}
    assert not [x for x in told if x.get("event") not in (None, "ahead")]
    assert results(told)[-1]["time"] == pytest.approx(6.0)


def test_a_beginning_with_a_silence_begins_behind_it(folder):
    lines = play(folder / "flight.nc").splitlines()
    later = [json.loads(x) for x in lines]
    for table in later[12:]:
        table["time"] += 50.0
    run, told = stream(folder, lines="".join(json.dumps(x) + "\n" for x in later))
    assert run.exit_code == 0
    assert results(told)[0]["time"] > 52.0 and results(told)[-1]["time"] == pytest.approx(56.0)


def test_a_model_that_does_not_follow_is_told_and_bands_grow(folder):
    """From 4 s on wheels have another momentum than they are commanded to."""
    lines = play(folder / "flight.nc").splitlines()
    turned = []
    for line in lines:
        table = json.loads(line)
        if table.get("time", 0.0) > 4.0:
            table["tacho.wheel_rate"] = [-1.5 * x for x in table["tacho.wheel_rate"]]
        turned.append(json.dumps(table) + "\n")
    _, sound = stream(folder, lines="\n".join(lines) + "\n")
    assert all(x["explained"] for x in results(sound))
    state = str(folder / "wrong.npz")
    _, told = stream(folder, "--save", state, lines="".join(turned))
    (event,) = [x for x in told if x.get("event") == "not explained"]
    assert event["time"] > 4.0 and "tacho.wheel_rate" in event["text"]
    last = results(told)[-1]
    assert not last["explained"]
    assert last["sigmas"]["bus.Izz"] > 3.0 * results(sound)[-1]["sigmas"]["bus.Izz"]
    words = ["stream", str(folder / "craft.toml"), "--restore", state]
    later = lines[0] + "\n" + lines[-1].replace('"time": 6.0', '"time": 6.1') + "\n"
    run = CliRunner().invoke(app, words, input=later, catch_exceptions=False)
    restored = results([json.loads(x) for x in run.stdout.splitlines()])[-1]
    assert restored["time"] == pytest.approx(6.1) and not restored["explained"]
    assert restored["sigmas"]["bus.Izz"] > 0.9 * last["sigmas"]["bus.Izz"]


def test_changes_are_told_as_they_are_found(folder):
    """From 20 s on, the second axis of the gyro reads three standard deviations too much."""
    turned = []
    for _, line in lines_of(flight(44.0, seed=5)):
        table = json.loads(line)
        if table.get("time", 0.0) >= 20.0:
            table["gyro.angular_rate"][1] += 3e-5
        turned.append(json.dumps(table) + "\n")
    words = ["--changes", "--follow", "gyro.angular_rate.bias.*=0"]
    _, told = stream(folder, *words, lines="".join(turned))
    (event,) = [x for x in told if x.get("event") == "change"]
    assert event["group"] == "gyro.angular_rate.bias" and 20.0 < event["time"] < 25.0
    assert abs(event["began"] - 20.0) <= event["grid"]
    axis = "gyro.angular_rate.bias.y"
    assert abs(event["jumps"][axis] - 3e-5) < 4.0 * event["sigmas"][axis]
    assert event["text"].startswith("gyro.angular_rate.bias changed at")


def test_a_clock_that_is_set_back_at_the_beginning_is_told(folder):
    """What comes twice, or between what there is, is late: once the whole stream ended in an error."""
    head, *lines = play(folder / "flight.nc").splitlines(keepends=True)
    samples = [json.loads(x) for x in lines]
    for sample in samples[15:]:
        sample["time"] -= 1.23
    run, told = stream(folder, lines=head + "".join(json.dumps(x) + "\n" for x in samples))
    assert run.exit_code == 0 and results(told)
    assert {x["event"] for x in told if "event" in x} >= {"late"}
