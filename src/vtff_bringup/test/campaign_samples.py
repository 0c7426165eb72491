"""Campaign files for tests, flown without ROS in milliseconds a case."""

from __future__ import annotations

import copy
import os
import pathlib
import signal
import subprocess
import sys
import time
from typing import Any

import pyarrow.parquet as pq

from vtff_bringup.campaign.campaign import PreparedCampaign, prepare_campaign
from vtff_bringup.campaign.campaign_file import load_campaign
from vtff_node.plain_yaml import format_yaml

# What differs between equal campaigns; the commit may change while tests run in a checkout.
TIMES = ["wall_time_s", "processor_time_s", "git_commit"]
ROOT = pathlib.Path(__file__).resolve().parents[3]

SMALL: dict[str, Any] = {
    "description": "a minute of the reference formation",
    "system": "reference_software",
    "loop": "library",
    "duration": 60.0,
    "samples": 4,
    "fixed": {
        "scenario.spacecraft.deputy.orbit": {"relative_rtn": {"position": [0.0, 1000.0, 0.0]}}
    },
    "vary": {
        "cap": {
            "sets": ["sdre_controller.acceleration_cap", "thruster.acceleration_cap"],
            "values": [1.2, 1.4],
        },
        "start": {
            "sets": ["scenario.spacecraft.deputy.orbit.relative_rtn.position.1"],
            "unit": "m",
            "distribution": "norm",
            "loc": 1000.0,
            "scale": 50.0,
        },
    },
    "figures": ["minimum_in_track_m", "delta_v_total_in_track_m_per_s", "settling_time_s"],
}


def changed(path: str, value: Any, base: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return a campaign with one field set (names with slashes between) or, with None, gone."""
    content = copy.deepcopy(SMALL if base is None else base)
    *before, last = path.split("/")
    entry = content
    for name in before:
        entry = entry.setdefault(name, {})
    if value is None:
        entry.pop(last, None)
    else:
        entry[last] = value
    return content


def write_campaign(folder: pathlib.Path, content: dict[str, Any] | None = None) -> pathlib.Path:
    """Write a campaign file."""
    path = folder / "small.yaml"
    path.write_text(format_yaml(SMALL if content is None else content), encoding="utf-8")
    return path


def prepared(folder: pathlib.Path, content: dict[str, Any] | None = None) -> PreparedCampaign:
    """Return a checked campaign that writes into ``folder/out``."""
    out = folder / "out"
    out.mkdir(exist_ok=True)
    return prepare_campaign(load_campaign(write_campaign(folder, content)), out, "failed")


def table_of(folder: pathlib.Path) -> Any:
    """Return the table of a campaign without its times."""
    return pq.read_table(folder / "cases.parquet").drop_columns(TIMES)


def start_campaign(file: object, out: object, *options: object) -> subprocess.Popen[str]:
    """Start the command in a process group of its own."""
    command = [sys.executable, "-m", "vtff_bringup.cli", "campaign", file, "--out", out, *options]
    return subprocess.Popen(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # A shell starts what runs in its background deaf to Ctrl-C, and programs inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        env={**os.environ, "COLUMNS": "200"},
    )


def wait_for_cases(out: pathlib.Path, count: int, process: subprocess.Popen[str]) -> None:
    """Wait until a campaign has finished so many cases."""
    journal = out / "cases.jsonl"
    while process.poll() is None:
        if journal.exists() and journal.read_bytes().count(b"\n") >= count:
            return
        time.sleep(0.02)
    raise AssertionError(f"ended before {count} cases: {process.communicate()[0]}")
