"""Tables of `vtff tec`."""

from __future__ import annotations

import json
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from vtff_analysis.large_tables import file_metadata, table_of_columns, write_table
from vtff_analysis.tec.processing import TecResult, rejection_counts
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import carrier_frequency_hz, satellite_name
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = [
    "content_table",
    "summarise_result",
    "summary_rows",
    "write_summary",
    "write_tables",
]

#: Units that the names of the columns do not tell.
_UNITS = {
    "gps_time": "GPS time, without leap seconds",
    "gps_time_end": "GPS time",
    "sigma_phi": "rad",
}


def content_table(result: TecResult) -> pa.Table:
    """Return the contents with a row for each satellite, pair of signals and epoch."""
    content = result.content
    pairs = content.rows.pairs
    has_link = pairs.link >= 0
    names = [satellite_name(link.system, link.prn) for link in content.links]
    codes = [f"{link.code_first}-{link.code_second}" for link in content.links]
    link = pairs.link[has_link]

    def select(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return values[has_link]

    return table_of_columns(
        {
            "gps_time": _gps_time(select(pairs.time)),
            "satellite": np.array(names, dtype=str)[link],
            "pair": np.array(codes, dtype=str)[link],
            "elevation_deg": np.degrees(select(content.rows.elevation)),
            "azimuth_deg": np.degrees(select(content.azimuth)),
            "pierce_latitude_deg": np.degrees(select(content.pierce_latitude)),
            "pierce_longitude_deg": np.degrees(select(content.pierce_longitude)),
            "stec_tecu": select(content.stec_tecu),
            "stec_sigma_tecu": select(content.stec_sigma_tecu),
            "stec_online_tecu": select(content.rows.stec_tecu),
            "stec_code_tecu": select(content.rows.stec_code_tecu),
            "vtec_tecu": select(content.vtec_tecu),
            "arc": select(content.rows.arc).astype(np.uint32),
            "rejected": select(content.rejected),
        }
    )


def _gps_time(nanoseconds: npt.NDArray[np.int64]) -> npt.NDArray[np.datetime64]:
    """Return GPS calendar times, without leap seconds, to the millisecond."""
    epoch = np.datetime64("1980-01-06T00:00:00", "ms")
    return epoch + (nanoseconds // 1_000_000).astype("timedelta64[ms]")


def write_tables(
    result: TecResult, folder: pathlib.Path, name: str, form: str
) -> list[pathlib.Path]:
    """Write contents, ROTI and scintillation as files whose names begin with `name`.

    Parameters
    ----------
    result
        The contents.
    folder, name
        Existing folder, and begin of the names.
    form
        ``parquet`` or ``csv``.

    Returns
    -------
    list of pathlib.Path
        The files.
    """
    roti = dict(result.roti)
    times = roti.pop("time_nanoseconds")
    tables = {
        "tec": content_table(result),
        "roti": table_of_columns({"gps_time_end": _gps_time(times), **roti}),
    }
    if result.scintillation:
        tables["scintillation"] = _scintillation_table(result)
    paths = []
    for kind, table in tables.items():
        path = folder / f"{name}_{kind}.{form}"
        paths.append(write_table(table, path, _UNITS, _metadata(result, kind)))
    return paths


def _metadata(result: TecResult, kind: str) -> dict[bytes | str, bytes | str]:
    time = result.source.table.time_nanoseconds
    first, last = (str(GpsTime(int(time[row]))) for row in (0, -1))
    about = {"table": kind, "source": result.source.description}
    return file_metadata(first, last, about)


def _scintillation_table(result: TecResult) -> pa.Table:
    windows = result.scintillation

    def join_column(name: str) -> npt.NDArray[Any]:
        return np.concatenate([getattr(window, name) for window in windows])

    times = np.concatenate([np.full(len(w.prn), w.time, dtype=np.int64) for w in windows])
    signals = zip(*(join_column(n).tolist() for n in ("band", "attribute")), strict=True)
    satellites = zip(*(join_column(n).tolist() for n in ("system", "prn")), strict=True)
    return table_of_columns(
        {
            "gps_time_end": _gps_time(times),
            "satellite": np.array([satellite_name(*satellite) for satellite in satellites]),
            "signal": np.array([f"{band}{chr(attribute)}" for band, attribute in signals]),
            **{
                name: join_column(name)
                for name in ("s4", "s4_corrected", "s4_pseudo", "sigma_phi", "cn0_dbhz", "samples")
            },
            "phase_cutoff_hz": np.concatenate(
                [np.full(len(window.prn), window.phase_cutoff_hz) for window in windows]
            ),
        }
    )


def summarise_result(result: TecResult) -> dict[str, Any]:
    """Return the numbers of a result for JSON and for the terminal."""
    content = result.content
    good = content.rejected == 0
    biases = []
    for (system, first, second), bias in sorted(content.receiver_biases.items()):
        bands = carrier_frequency_hz([system] * 2, [int(first[1]), int(second[1])])
        value, sigma = bias.code_bias(tecu_per_metre(float(bands[0]), float(bands[1])))
        biases.append(
            {
                "pair": f"{satellite_name(system, 0)[0]} {first}-{second}",
                "bias_ns": 1e9 * value,
                "sigma_ns": 1e9 * sigma,
                "bias_tecu": bias.bias_tecu,
                "sigma_tecu": bias.sigma_tecu,
            }
        )
    vertical = content.vtec_tecu[good & np.isfinite(content.vtec_tecu)]
    time = result.source.table.time_nanoseconds
    return {
        "source": result.source.description,
        "first_epoch": str(GpsTime(int(time[0]))),
        "last_epoch": str(GpsTime(int(time[-1]))),
        "samples": len(good),
        "good_samples": int(np.count_nonzero(good)),
        "rejected_samples": rejection_counts(content.rejected),
        "receiver_biases": biases,
        "vtec_tecu": (
            {
                "minimum": float(vertical.min()),
                "median": float(np.median(vertical)),
                "maximum": float(vertical.max()),
            }
            if len(vertical)
            else None
        ),
        "roti_interval": result.roti_interval,
        "roti_window": result.roti_window,
        "remarks": list(result.remarks),
    }


def summary_rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Return a summary of `summarise_result` as rows of a page: a name and a text with units."""
    rows = [
        ("epochs", f"{summary['first_epoch']} to {summary['last_epoch']}"),
        ("good samples", f"{summary['good_samples']} of {summary['samples']}"),
    ]
    rows += [
        (f"rejected: {reason.lower().replace('_', ' ')}", str(count))
        for reason, count in summary["rejected_samples"].items()
    ]
    rows += [
        (
            f"receiver bias {bias['pair']}",
            f"{bias['bias_ns']:.2f} \u00b1 {bias['sigma_ns']:.2f} ns, in slant TEC "
            f"{bias['bias_tecu']:.2f} \u00b1 {bias['sigma_tecu']:.2f} TECU",
        )
        for bias in summary["receiver_biases"]
    ]
    vertical = summary["vtec_tecu"]
    if vertical is not None:
        text = f"{vertical['minimum']:.1f} to {vertical['maximum']:.1f} TECU"
        rows.append(("vertical TEC", f"{text}, median {vertical['median']:.1f} TECU"))
    rates = f"over {summary['roti_interval']:g} s in windows of {summary['roti_window']:g} s"
    return [*rows, ("rates of TEC (ROTI)", rates)]


def write_summary(results: list[dict[str, Any]], path: pathlib.Path) -> None:
    """Write the summaries of all receivers as JSON."""
    path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
