"""A store of a SIMULATED fleet for scripts/bench: drawn from estimates of one calibration, then asked by commands."""

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
from bench_commands import spent

import irbcal
from irbcal.fleet.adding import stored
from irbcal.fleet.store import Stored, factor_of, opened
from irbcal.io import robots

TIMES, MOVED, MOVED_DEG, BATCH = 4, 10, 0.1, 200
"""Calibrations of each robot; of every tenth robot a zero moves by so much before the last; added at a time."""
LIMITS = {"list": 5.0, "drift": 10.0, "drift R00010": 2.0, "prior --type type --out prior.json": 10.0}


def drawn(one: Stored, count: int, seed: int = 0) -> Iterator[Stored]:
    """Calibrations of robots that differ by 0.3 natural sizes, each seen with the uncertainty of the first."""
    rng = np.random.default_rng(seed)
    level, terms = one.level, one.terms
    noise = [factor_of(estimate.covariance, estimate.std) for estimate in (level, terms)]
    for r in range(count):
        name = f"R{r:05d}"
        true = [0.3 * estimate.natural * rng.standard_normal(len(estimate.names)) for estimate in (level, terms)]
        for again in range(TIMES):
            if r % MOVED == 0 and again == TIMES - 1:
                true[0][level.column_of[f"delta_theta{r // MOVED % 3 + 2}"]] += np.radians(MOVED_DEG)
            values = [x + L @ rng.standard_normal(len(x)) for x, L in zip(true, noise, strict=True)]
            head = {"robot": name, "measured": date(2020 + again, 1, 1), "fingerprint": f"{r:016d}{again:016d}"}
            error = 0.07 * float(np.exp(0.1 * rng.standard_normal()))
            yield replace(
                one,
                robot={"id": name, "serial": f"SN-{r}", "type": "type"},
                calibration={**one.calibration, **head, "folder": f"/data/{again}/{name}", "heldout_mean_mm": error},
                level=replace(level, values=values[0]),
                terms=replace(terms, values=values[1]),
            )


def fleets(add, folder: Path, sizes: tuple[int, ...]) -> None:
    """Stores of so many robots: seconds and memory of commands, and how they grow with the number of robots."""
    calibration = folder / "one"
    if not calibration.exists():
        irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600").save(calibration)
    one = stored(calibration, "R", "SN", "2026-01-01")
    before: dict[str, float] = {}
    for count in sizes:
        path = folder / f"fleet{count}.db"
        seconds = 0.0
        with opened(path, create=True) as store:
            batch: list[Stored] = []
            for calibration_drawn in drawn(one, count):
                batch.append(calibration_drawn)
                if len(batch) == BATCH:
                    start = time.process_time()
                    store.add_all(batch)
                    seconds += time.process_time() - start
                    batch = []
            store.add_all(batch)
        calibrations = f"{TIMES * count:,} calibrations"
        add(f"adding to a store, {calibrations}", seconds, path.stat().st_size / 2**20)
        for words, limit in LIMITS.items():
            taken, memory = spent(
                "fleet", *words.replace("prior.json", str(folder / "p.json")).split(), "--store", path
            )
            slope = math.log10(taken / before[words]) / math.log10(count / sizes[0]) if words in before else None
            add(f"irbcal fleet {words}, {calibrations}", taken, memory, limit, slope)
            before.setdefault(words, taken)
        path.unlink()
