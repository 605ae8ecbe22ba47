"""``fleet.html``: all robots of a fleet on one page that runs no script and loads nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from irbcal.figures.colours import CALIBRATED, NOMINAL
from irbcal.summary import Table

if TYPE_CHECKING:
    from irbcal.fleet.calibrated import CalibratedFleet
    from irbcal.fleet.overview import Overview


def render(fleet: CalibratedFleet) -> str:
    """The page of a list's calibrations."""
    largest = max([r.nominal_mm or 0.0 for r in fleet.robots] + [r.mean_mm or 0.0 for r in fleet.robots] + [1e-9])
    return _page(
        "list.html.j2",
        title="Fleet",
        simulated=any(r.simulated for r in fleet.robots),
        headline=fleet.headline(),
        robots=fleet.robots,
        share=lambda length: f"{100.0 * (length or 0.0) / largest:.1f}",
        nominal=NOMINAL,
        calibrated=CALIBRATED,
    )


def render_store(overview: Overview) -> str:
    """The page of a store's robots."""
    return _page(
        "store.html.j2",
        title="Fleet",
        simulated=overview.simulated,
        headline=overview.headline(),
        told=overview.told()[1:],
        is_table=lambda item: isinstance(item, Table),
    )


def _page(template: str, **names: object) -> str:
    from irbcal.templates import environment

    return environment("irbcal.fleet").get_template(template).render(**names)
