"""Receiver biases of emulated station days, against the truth.

Each day has a station, a plasma with horizontal gradients, crests and waves, and biases of receiver
and satellites of its own, drawn by seed (benchmarks/plasma/station_days.py); satellite biases are
known to 0.1 ns. GPS L1/L2 of 30 s goes through `absolute_tec`, as a file does
in `vtff tec`. Printed are the error of the receiver bias beside its sigma, and the errors of the
slant contents beside theirs.
"""

from __future__ import annotations

import argparse
import os
import sys

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it; as the vtff command does.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})

import numpy as np  # noqa: E402
from plasma.station_days import StationDay, draw_station_day  # noqa: E402
from tables import add_write_option, write_rows  # noqa: E402

from vtff_gnss.constants import FREQUENCY_L1, FREQUENCY_L2, SYSTEM_GPS  # noqa: E402
from vtff_iono.content.absolute_tec import AbsoluteTec, absolute_tec  # noqa: E402
from vtff_iono.links.geometry_free import tecu_per_metre  # noqa: E402
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS  # noqa: E402

COLUMNS = ("days", "receiver bias: error over sigma", "slant contents")
"""Columns of the row that is kept."""
_KEY = (SYSTEM_GPS, "C1C", "C2W")


def process(day: StationDay) -> AbsoluteTec:
    """Return the contents of a day."""
    return absolute_tec(
        day.time,
        day.columns,
        day.position_itrf,
        day.ephemerides,
        lambda link, time: (day.satellite_bias[link.prn], day.bias_sigma),
        pairs=DEFAULT_PAIRS[:1],
    )


def content_errors(day: StationDay, found: AbsoluteTec) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the good slant contents and their sigmas, TECU."""
    prn = np.array([link.prn for link in found.links] + [0])[found.rows.pairs.link]
    good = np.flatnonzero((found.rejected == 0) & np.isfinite(found.stec_tecu))
    times, satellites = found.rows.pairs.time[good].tolist(), prn[good].tolist()
    true = [day.content_tecu[key] for key in zip(times, satellites, strict=True)]
    return found.stec_tecu[good] - np.array(true), found.stec_sigma_tecu[good]


def main() -> None:
    """Draw, process and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="first seed (%(default)s)")
    parser.add_argument("--count", type=int, default=20, help="days (%(default)s)")
    parser.add_argument(
        "--plasmasphere",
        type=float,
        default=0.0,
        help="vertical content above the layer at the equator, TECU (%(default)g)",
    )
    add_write_option(parser, "station_days")
    options = parser.parse_args()
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2)
    print(
        "| seed | latitude, deg; content at night, in the afternoon, TECU | receiver bias: error, "
        "sigma, ns; error over sigma | slant content: RMS, TECU; error over sigma, RMS |"
    )
    print("|---|---|---|---|")
    ratios, squares = [], []
    for number in range(options.count):
        seed = options.seed + number
        print(f"{number + 1} of {options.count}", file=sys.stderr, flush=True)
        day = draw_station_day(seed, options.plasmasphere)
        found = process(day)
        value, sigma = found.receiver_biases[_KEY].code_bias(scale)
        error = value - day.receiver_bias
        contents, sigmas = content_errors(day, found)
        ratios.append(error / sigma)
        squares.append(float(np.mean(contents**2)))
        plasma = day.truth
        print(
            f"| {seed} | {day.latitude_deg:.0f}; {plasma.content_night:.0f}, "
            f"{plasma.content_night + plasma.content_day:.0f} | {1e9 * error:+.2f}, "
            f"{1e9 * sigma:.2f}; {error / sigma:+.2f} | {np.sqrt(squares[-1]):.2f}; "
            f"{np.sqrt(np.mean((contents / sigmas) ** 2)):.2f} |",
            flush=True,
        )
    print(
        f"receiver bias: error over sigma, RMS of {len(ratios)} days: "
        f"{np.sqrt(np.mean(np.square(ratios))):.2f}, mean {np.mean(ratios):+.2f}; "
        f"slant content RMS {np.sqrt(np.mean(squares)):.2f} TECU"
    )
    if options.write:
        sky = f", plasmasphere of {options.plasmasphere:g} TECU" if options.plasmasphere else ""
        row = [
            f"{options.count} emulated days{sky}",
            f"{np.sqrt(np.mean(np.square(ratios))):.2f}, mean {np.mean(ratios):+.2f}",
            f"{np.sqrt(np.mean(squares)):.2f} TECU",
        ]
        last = options.seed + options.count - 1
        write_rows("station_days", COLUMNS, [row], f"{options.seed} to {last}")


if __name__ == "__main__":
    main()
