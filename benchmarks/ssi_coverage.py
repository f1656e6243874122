"""Intervals of SSI-COV over Monte Carlo records: spread against prediction, and coverage.

    python benchmarks/ssi_coverage.py 400

Three masses on a line under white force with 5 % of sensor noise, 40 minutes at 20 Hz; frequencies and
damping in closed form.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from _common import ROOT, environment, write_result
from scipy.stats import binom

sys.path.insert(0, str(ROOT / "tests"))

from identify.test_ssi_uncertainty import DAMPING, RATE, chain, truth

from smsid.identify.ssi_uncertainty import ssi_cov_uncertain

SAMPLES, ROWS, SEGMENTS = 48_000, 20, 60


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("records", type=int)
    records = parser.parse_args().records
    frequency, _ = truth()
    scores, inside = [], []
    for seed in range(records):
        y = chain(np.random.default_rng(seed), SAMPLES)
        found = ssi_cov_uncertain(y, RATE, block_rows=ROWS, orders=[6], segments=SEGMENTS)[0]
        poles = found.poles
        scores.append(
            [
                (poles.frequency - frequency) / found.frequency_sigma,
                (poles.damping - DAMPING) / found.damping_sigma,
            ]
        )
        inside.append(
            [
                (a[:, 0] < t) & (t < a[:, 1])
                for a, t in zip(found.interval(), (frequency, DAMPING), strict=True)
            ]
        )
    cover = np.mean(inside, axis=0)
    low, high = binom.ppf([0.005 / 6, 1 - 0.005 / 6], records, 0.95) / records
    result = {
        "environment": environment("numpy", "scipy"),
        "records": records,
        "spread / predicted, frequency": np.std(scores, axis=0)[0].tolist(),
        "spread / predicted, damping": np.std(scores, axis=0)[1].tolist(),
        "coverage 95 %, frequency": cover[0].tolist(),
        "coverage 95 %, damping": cover[1].tolist(),
        "mean coverage": float(cover.mean()),
        "chance: band of a coverage": [float(low), float(high)],
    }
    print(result)
    write_result("ssi_coverage", result)


if __name__ == "__main__":
    main()
