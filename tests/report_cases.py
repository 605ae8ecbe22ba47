"""Calibrations that a report must be able to show: hostile names, any number of points, nothing held out."""

import re
from collections import Counter

import numpy as np
from lxml import html

from irbcal.error_statistics import RotationStatistics, Statistics
from irbcal.identification.fit_sections import Candidate, CorrelatedPair, LevelChoice, ParameterReport
from irbcal.io.packed_covariance import PackedCovariance
from irbcal.io.point_tables import PointTable
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.points import Errors

NASTY = "</title><script>alert(1)</script>$\\frac$<img src=x onerror=alert(2)>\"'&amp;{{ 7*7 }}]]>漢字"


def some_errors(mean, targets=("smr1",), groups=(), orientation=None):
    def statistics(mean):
        return Statistics(
            n=888, mean_mm=mean, sigma_mm=0.3212719, max_mm=2.5, mean_plus_3sigma_mm=mean + 1, rms_mm=mean + 0.1
        )

    return Errors(
        all=statistics(mean),
        orientation=orientation,
        per_target={name: statistics(mean + 0.01 * k) for k, name in enumerate(targets)},
        per_group={name: statistics(mean + 0.02 * k) for k, name in enumerate(groups)},
    )


def with_points(calibration, poses, targets, groups=()):
    """As many held-out and fitted points as wanted."""
    n = poses * targets
    names = [f"t{k}" for k in range(targets)]
    columns = {
        "pose": [str(k // targets) for k in range(n)],
        "group": [groups[k // targets % len(groups)] if groups else "" for k in range(n)],
        "target": names * poses,
        "nominal_mm": np.random.default_rng(1).gamma(4.0, 0.2, n).tolist(),
        "calibrated_mm": np.random.default_rng(2).gamma(3.0, 0.1, n).tolist(),
    }
    table = PointTable(**{key: value * 2 for key, value in columns.items()}, heldout=[False] * n + [True] * n)
    before, after = some_errors(0.8, names, groups), some_errors(0.3, names, groups)
    return calibration.model_copy(
        update={
            "points": table,
            "fit": after,
            "heldout": after,
            "fit_nominal": before,
            "heldout_nominal": before,
            "poses_fit": poses,
            "poses_heldout": poses,
        }
    )


def without_heldout(calibration):
    keep = [k for k, heldout in enumerate(calibration.points.heldout) if not heldout]
    columns = calibration.points.model_dump().items()
    table = {name: [column[k] for k in keep if column] for name, column in columns}
    update = {"heldout": None, "heldout_nominal": None, "poses_heldout": 0, "points": PointTable(**table)}
    return calibration.model_copy(update=update)


def everywhere(calibration, name):
    """The name in every place that a file or a person fills."""
    robot = calibration.robot.model_copy(
        update={"name": name, "urdf": name, "base_link": name, "tip_link": name, "joint_names": [name] * 6}
    )
    placed = calibration.placement.model_copy(
        update={"targets_mm": {name: [1.0, 2.0, 3.0]}, "target_quaternions": {name: [1.0, 0.0, 0.0, 0.0]}}
    )
    candidate = Candidate(level="34", mean_mm=0.3, gain_mm=None, gain_std_mm=None, chosen=True, refused=name)
    pair = CorrelatedPair(first=name, second=name, coefficient=0.99)
    turned = RotationStatistics(n=1, mean_deg=0.0123456, sigma_deg=0.0, max_deg=0.0123456)
    parameter = ParameterReport(name=name, value=1.0, unit="mm", std=1.0, low=-1.0, high=3.0, state="tied", reason=name)
    errors = some_errors(0.3, (name, "b"), (name,), turned)
    return calibration.model_copy(
        update={
            "robot": robot,
            "placement": placed,
            "placement_nominal": placed,
            "references_mm": {name: [1.0, 2.0, 3.0]},
            "tool_shape_mm": {},
            "covariance": PackedCovariance.from_matrix(np.zeros((1, 1))),
            "largest_link_shift_mm": 1.0,
            "created": name,
            "model": name,
            "undetermined": [name],
            "notes": [name],
            "excluded": [Exclusion(pose=name, target=name, reason=name)],
            "parameters": [parameter],
            "method": name,
            "choice": LevelChoice(level="34", table=[candidate], explanation=name),
            "observability": calibration.observability.model_copy(
                update={"correlations": [pair], "indices": {name: 1.0}}
            ),
            "data": [calibration.data[0].model_copy(update={"file": name})],
            "software": {name: name},
            "points": PointTable(
                pose=[name], group=[name], target=[name], heldout=[True], nominal_mm=[0.2], calibrated_mm=[0.1]
            ),
            **dict.fromkeys(("fit", "fit_nominal", "heldout", "heldout_nominal", "heldout_least_squares"), errors),
        }
    )


def text_of(page):
    return " ".join(html.document_fromstring(page).text_content().split())


def assert_harmless(page):
    """Nothing runs, nothing is loaded, ids are unique and every inner link has its aim."""
    document = html.document_fromstring(page)
    assert "<script" not in page.lower()
    assert not re.search(r"https?:", page)
    assert {e.tag for e in document.iter() if isinstance(e.tag, str)}.isdisjoint(
        {"script", "img", "iframe", "link", "image", "use", "style.src"}
    )
    ids = Counter(document.xpath("//@id"))
    assert max(ids.values()) == 1
    for element in document.iter():
        for name, value in element.attrib.items():
            assert not name.startswith("on"), (name, value)
            assert name != "src"
            if name == "href":
                assert element.tag == "a"
                assert value[0] == "#"
                assert value[1:] in ids
    assert "url(" not in page
    assert "@import" not in page


def drawings(page, words=""):
    """The drawings of a page whose label has these words, legends aside."""
    return [svg for svg in html.document_fromstring(page).xpath("//svg[@role='img']") if words in svg.get("aria-label")]
