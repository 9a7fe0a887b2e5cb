"""Campaigns on one machine."""

from __future__ import annotations

import json
import shutil

import pytest

import boresight
import simulated_campaign
from simulated_campaign import contents, truncate


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return simulated_campaign.make(tmp_path_factory.mktemp("campaign") / "beets", plots=1, dates=2)


def test_python_does_what_the_command_does(command, made, tmp_path):
    found = boresight.campaign(made.path, tmp_path / "python", workers=2, progress=None)
    assert [item["state"] for item in found.items] == ["finished"] * 5 and not found.failed
    command("campaign", made.path, "--out", tmp_path / "command", "--workers", "2", "--quiet")
    ours, theirs = contents(tmp_path / "python"), contents(tmp_path / "command")
    assert ours == theirs and len(ours) > 20
    assert json.loads((tmp_path / "python" / "campaign.json").read_text()) == found.to_dict()
    assert "5 items" in found.summary and "campaign.html" in found._repr_html_()


def test_folders_as_of_fieldpheno4d(tmp_path):
    made = simulated_campaign.make_pheno4d(tmp_path / "pheno", plots=1, dates=2)
    found = boresight.campaign(made.path, workers=2, progress=None)
    assert not found.failed, found.failed
    assert [item["kind"] for item in found.items] == ["drive", "drive", "change"]
    change = tmp_path / "pheno" / "out" / "items" / found.items[2]["name"] / "result.json"
    # What the robot drove lower, the soil has settled.
    assert abs(json.loads(change.read_text())["change"]["median_m"] + simulated_campaign.SETTLED_M) < 1e-3


def test_a_failure_is_named_and_nothing_else_suffers(made, tmp_path):
    folder = tmp_path / "beets"
    shutil.copytree(made.path.parent, folder)
    truncate(folder / "drives" / made.dates[1] / "P01" / "left.bin")
    found = boresight.campaign(folder / "campaign.toml", workers=2, progress=None)
    assert [(item["kind"], item["plot"]) for item in found.failed] == [("drive", "P01"), ("change", "P01")]
    assert "left.bin" in found.failed[0]["problem"] and "needs drive P01" in found.failed[1]["problem"]
    assert sum(item["state"] == "finished" for item in found.items) == 3
    assert "left.bin" in found._repr_html_()
