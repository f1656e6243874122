"""``smsid compare`` prints a screen, writes JSON and a page, and what it writes can be shown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from smsid.identify.estimate import save_estimate
from tests.comparison.estimates import CRAFT, craft, estimate, grasped
from tests.screen import fits

from .test_output import smsid


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    save_estimate(estimate(craft(), rng, noise=0.2, name="one"), "a.json")
    save_estimate(estimate(grasped(60.0), rng, noise=0.2, name="two"), "b.json")
    save_estimate(estimate(craft(), rng, noise=0.2, name="three"), "c.json")


def test_a_grasped_body_is_told_on_one_screen(files):
    code, out, err = smsid("compare", "a.json", "b.json", "--description", CRAFT, "--report", "r.html")
    assert code == 0, err
    fits(out)
    assert "grasped by, or fixed to, link3" in " ".join(out.split())
    document = json.loads(Path("comparison.json").read_text(encoding="utf-8"))
    assert document["changed"] and document["findings"][0]["subject"] == "link3"
    assert "link3" in Path("r.html").read_text(encoding="utf-8")
    code, shown, _ = smsid("show", "comparison.json")
    assert code == 0 and "link3" in shown
    fits(shown)


def test_the_same_craft_is_said_to_be_the_same(files):
    code, out, _ = smsid("compare", "a.json", "c.json")
    assert code == 0 and "No change beyond chance" in out
    fits(out)


def test_json_is_the_comparison(files):
    code, out, _ = smsid("compare", "a.json", "b.json", "--json")
    document = json.loads(out)
    assert code == 0 and document["kind"] == "comparison"
    assert document["findings"][0]["kind"] == "body_grasped"


def test_an_output_that_is_an_input_is_refused(files):
    code, _, err = smsid("compare", "a.json", "b.json", "-o", "b.json")
    assert code == 1 and "is an input" in err


def test_a_description_in_the_place_of_an_estimate_is_said(files):
    code, _, err = smsid("compare", CRAFT, "b.json")
    assert code == 1 and "estimate (JSON)" in err
