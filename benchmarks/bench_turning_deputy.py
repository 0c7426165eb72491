"""Runs of reference_attitude: attitude and navigation of the deputy, in pieces of 200 s.

Fly them with `vtff run reference_attitude --duration 2800 --seed N --out FOLDER`; receivers, CAN
buses and all nodes take part. NEES is e' P^-1 e over its degrees of freedom, so 1 is honest; the
errors of a piece are hardly independent, so that single pieces scatter. The first piece is left
out: navigation has no integers in it.
"""

from __future__ import annotations

import argparse
import pathlib

import numpy as np

from vtff_analysis.evaluation.attitude import attitude_errors, pointing_angles_deg
from vtff_analysis.recordings.history import DeputyHistory, RunHistory, seconds_since
from vtff_analysis.recordings.recording import read_run
from vtff_analysis.recordings.run_place import find_run
from vtff_dynamics.vectors import FloatArray

_PIECE = 200.0  # s


def evaluate(run: RunHistory) -> FloatArray:
    """Print the pieces of a run and return their NEES of attitude and position, (pieces, 2)."""
    [(name, recording)] = run.attitude.items()
    attitude = attitude_errors(recording)
    if attitude is None:
        raise SystemExit("no attitude, true and estimated, in this run")
    time = seconds_since(run.start_time, attitude.time)
    pointed, angles = pointing_angles_deg(recording)
    pointed_time = seconds_since(run.start_time, pointed)
    known_time, position, sigma, squares = _navigation(run, run.deputies[name])
    print(
        "  until, s: attitude off, its sigma (deg), NEES | roll, pitch, yaw, RMS, deg | position "
        "off along R, T, N, its sigma (mm), NEES"
    )
    rows = []
    for start in np.arange(_PIECE, time[-1] - 0.5 * _PIECE, _PIECE):
        first = (time > start) & (time <= start + _PIECE)
        second = (pointed_time > start) & (pointed_time <= start + _PIECE)
        third = (known_time > start) & (known_time <= start + _PIECE)
        rows.append([attitude.mean_nees(first), float(squares[third].mean())])
        print(
            f"  {start + _PIECE:6.0f}: {_rms(attitude.angle_deg[first]):.2f} "
            f"{_rms(attitude.sigma_deg[first]):.2f} {rows[-1][0]:.2f} | "
            f"{_rms(angles[second]).round(2)} | {(1e3 * _rms(position[third])).round(1)} "
            f"{(1e3 * _rms(sigma[third])).round(1)} {rows[-1][1]:.2f}"
        )
    if not rows:
        raise SystemExit(f"this run has no piece: it is shorter than {1.5 * _PIECE:.0f} s")
    return np.array(rows)


def _navigation(
    run: RunHistory, deputy: DeputyHistory
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return times (s), errors and sigmas of the position in RTN (m), and their NEES."""
    truth, estimate, navigation = deputy.truth, deputy.estimate, deputy.navigation
    if truth is None or estimate is None or navigation is None:
        raise SystemExit("no relative state, true and estimated, in this run")
    time, of_truth, of_estimate = np.intersect1d(truth.time, estimate.time, return_indices=True)
    error = truth.position_rtn[of_truth] - estimate.position_rtn[of_estimate]
    covariance = navigation.position_covariance_rtn[of_estimate]
    solved = np.linalg.solve(covariance + 1e-12 * np.eye(3), error[:, :, None])[..., 0]
    squares = np.einsum("ij,ij->i", error, solved) / 3.0
    sigma = navigation.position_sigma_rtn[of_estimate]
    return seconds_since(run.start_time, time), error, sigma, squares


def _rms(values: FloatArray) -> FloatArray:
    rms: FloatArray = np.sqrt(np.mean(np.square(values), axis=0))
    return rms


def main() -> None:
    """Print the runs of the command line, and their pieces together."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=pathlib.Path, help="folders of runs")
    pieces = []
    for folder in parser.parse_args().runs:
        run = read_run(find_run(folder).bag)
        taken = run.safety.taken_over if run.safety is not None else {}
        reasons = "; ".join(f"{name}: {one.reason}" for name, one in taken.items())
        print(f"{folder}: taken over: {reasons or 'nothing'}")
        pieces.append(evaluate(run))
        print(f"  mean NEES of attitude and position {pieces[-1].mean(axis=0).round(2)}")
    together = np.concatenate(pieces)
    within = ((together >= 0.5) & (together <= 1.5)).sum(axis=0)
    print(
        f"{len(together)} pieces: mean NEES {together.mean(axis=0).round(2)}, largest "
        f"{together.max(axis=0).round(2)}, from 0.5 to 1.5 in {within}"
    )


if __name__ == "__main__":
    main()
