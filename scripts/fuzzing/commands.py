"""Calls of every command: good ones, then damaged in their files, their paths and their options."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from fuzzing import corpus
from fuzzing.damage import NUMBERS, TEXTS, damaged

KINDS = {
    ".csv": "csv",
    ".json": "json",
    ".jsonl": "csv",
    ".urdf": "xml",
    ".yaml": "yaml",
    ".txt": "csv",
    ".db": "store",
}


@dataclass
class Call:
    """A command with its options; ``@name`` stands for an input, ``>name`` for an output, ``<name`` for its stdin."""

    words: list[str]
    checks: dict[str, str] = field(default_factory=dict)


Maker = Callable[[Random], list[str]]


def _some(random: Random, *options: list[str]) -> list[str]:
    return [word for option in options if random.random() < 0.3 for word in option]


def _robot(random: Random) -> str:
    return random.choice(("@cal", "@robot.urdf", "@small.urdf", "@cal-map", "@cal-auto", "irb120"))


def _load(random: Random) -> list[str]:
    return ["--payload", random.choice(("0", "2", "1e308", "nan")), *_some(random, ["--payload-centre", "0,0,60"])]


def _fk(random: Random) -> list[str]:
    more = _some(random, ["--json"], ["--target", "smr1"], ["--uncertainty"], ["--intervals"], ["--nominal"])
    more += _some(random, _load(random)) if random.random() < 0.3 else []
    return ["fk", _robot(random), "--joints", "@j.csv", *more]


def _ik(random: Random) -> list[str]:
    more = _some(random, ["--json"], ["--all-branches"], ["--nominal"], ["--near", "0,0,0,0,0,0"], ["--path"])
    more += _some(random, _load(random)) if random.random() < 0.3 else []
    return ["ik", random.choice(("@cal", "@robot.urdf", "@cal-map", "@cal-auto")), "--poses", "@p.csv", *more]


def _filter(random: Random) -> list[str]:
    endings = corpus.endings()
    name = random.choice(sorted(endings))
    files = corpus.programs()[name]
    suffixes = [path.suffix for path in files] or [random.choice(endings[name])]
    suffixes = [random.choice((".csv", ".parquet"))] if name == "table" else suffixes
    several = len(files) == 1 and random.random() < 0.15
    out = ">out" if several or len(suffixes) > 1 else f">out{suffixes[0]}"
    calibration = f"@cal-{name}" if corpus.axes_of(name) else random.choice(("@cal", "@cal", "@cal-map", "@cal-auto"))
    more = _some(
        random,
        ["--json"],
        ["--changes", ">changes.csv"],
        [
            "--tool",
            random.choice(("t=0,0,100,1,0,0,0", "1=0,0,100,0,0,0", "X=nan,0,0,1,0,0,0", "tool1=1e308,0,0,1,0,0,0")),
        ],
        ["--wobj", random.choice(("w=0,0,0,1,0,0,0", "1=0,0,0,0,0,0", "wobj1=0,0,0,0,0,0,0"))],
        ["--pulses", random.choice(("1000,1000,1000,1000,1000,1000", "0,0,0,0,0,0", "nan,1,1,1,1,1"))],
        [
            random.choice(("--start", "--posture")),
            random.choice(("0,0,0,0,30,0", "0,-90,90,0,30,0", "0,0", "nan,0,0,0,0,0")),
        ],
    )
    more += _some(random, ["--split-points"], _load(random), ["--ignored-calls", "*"])
    if random.random() < 0.6:
        more.append("--allow-partial")
    given = [f"@jobs-{name}"] if several else [f"@{name}{suffix}" for suffix in suffixes]
    return ["filter", calibration, *given, "--out", out, *more]


def _verify(random: Random) -> list[str]:
    more = _some(random, ["--json"], random.choice((["--urdf", "@robot.urdf"], ["--program", "@rapid.mod"])))
    calibration = random.choice(("@cal", "@cal-map", "@cal-auto"))
    return ["verify", calibration, *(["--reseal", "why"] if random.random() < 0.1 and not more else more)]


def _cell(random: Random) -> list[str]:
    if random.random() < 0.2:
        name = random.choice([name for name, files in corpus.programs().items() if len(files) == 1])
        return [
            "cell",
            f"@cal-{name}" if corpus.axes_of(name) else "@cal-auto",
            f"@jobs-{name}",
            "--out",
            ">touches.csv",
        ]
    touches = random.choice((["@touches.csv"], ["@touches.csv"], ["@touches-axes.csv", "--axes", "@axes.csv"]))
    more = _some(
        random, ["--json"], ["--as", random.choice(("kuka", "abb", "fanuc", "ur", "x"))], ["--declare", ">frames.txt"],
        ["--program", "@" + random.choice(sorted(corpus.programs()))], ["--touch", "tool 1 socket=P1,P2,P3"],
        ["--urdf", ">cell.urdf"], ["--report", ">cell.html"],
    )  # fmt: skip
    return ["cell", random.choice(("@cal", "@cal-map", "@cal-auto")), *touches, "--out", ">cell.json", *more]


def _sign(random: Random) -> list[str]:
    return ["sign", "@cal", "--key", ">lab.pem", *_some(random, ["--new-key"])]


def _evaluate(random: Random) -> list[str]:
    more = _some(
        random, ["--json"], ["--flange"], ["--refit-base"], ["--relative", "virtual"], ["--sphere", "900,0,700,800"],
        ["--relative", "three-points"], ["--verified", "@v.csv"], ["--refit-zeros", random.choice(("3,5", "0", "x"))],
    )  # fmt: skip
    if random.random() < 0.3:
        more = _some(random, ["--json"], ["--refit-tool"], ["--intervals"], ["--same-tool"], ["--payload", "1"])
        return ["evaluate", "@cal-auto", "@auto-v.csv", *more]
    if random.random() < 0.15:
        more += [
            "--report",
            ">c.html",
            "--tolerance",
            "0.5",
            *_some(random, ["--data", ">tables"], ["--info", "robot=a"]),
        ]
    return ["evaluate", "@cal", "@v.csv", *more]


def _compare(random: Random) -> list[str]:
    more = _some(random, ["--json"], ["--refit-base"], ["--csv", ">c.csv"], ["--latex", ">c.tex"])
    return ["compare", "@cal", "@cal2", *_some(random, ["@cal-map"]), "--measurements", "@v.csv", *more]


def _calibrate(random: Random) -> list[str]:
    more = _some(
        random, ["--json"], ["--targets", "@t.csv"], ["--verify", "@v.csv"], ["--as-poses"], ["--world-link"],
        ["--holdout", "0"], ["--frame", "ref1,ref2,ref3"], ["--loss", "huber"], ["--hold", "gain*"], ["--split", "last"],
        ["--mesh-paths", "absolute"], ["--mesh-paths", "relative"], ["--package-dir", "."],
    )  # fmt: skip
    kind = random.random()
    if kind < 0.15:
        return ["calibrate", "@v.csv", "--with", "@cal-map", "--out", ">new", *_some(random, ["--json"])]
    if kind < 0.3:
        more = _some(random, ["--json"], ["--same-tool"], ["--payload-centre", "0,0,60"], ["--terms", "all"])
        return ["calibrate", "@auto-m.csv", "--robot", "irb120", "--out", ">new", *more]
    if kind < 0.45:
        more = _some(random, ["--json"], ["--leave-out", "feature"], ["--leave-out", "none"])
        return ["calibrate", "@f.csv", "--features", "@f.features.csv", "--robot", "irb1600", "--out", ">new", *more]
    if kind < 0.5:
        return ["calibrate", "@messy.csv", "--robot", "irb1600", "--out", ">new", "--model", "16", *more]
    robot = random.choice(("@robot.urdf", "@small.urdf", "@robot.xacro", "irb1600"))
    return ["calibrate", "@m.csv", "--robot", robot, "--out", ">new", "--model", random.choice(("16", "26")), *more]


def _view(random: Random) -> list[str]:
    what = random.choice((["@cal", "@v.csv"], ["@cal"], ["@robot.urdf"], ["@small.urdf"], ["@robot.urdf", "@j.csv"],
                          ["@cal-auto", "@auto-v.csv"]))  # fmt: skip
    return ["view", *what, "--html", ">view.html", *_some(random, ["--magnify", "100"], ["--refit-base"])]


def _report(random: Random) -> list[str]:
    return ["report", random.choice(("@cal", "@cal-map", "@cal-auto")), "--data", ">tables", *_some(random, ["--json"])]


def _import(random: Random) -> list[str]:
    calls = (
        ["@lab.csv", "--as", "@map.yaml"],
        ["@lab.csv", "--as", "ur10-lab"],
        ["@sa.txt", "--as", "spatial-analyzer", "--set", "units.lengths=mm", "--joints", "@pj.csv"],
        ["@tmac.csv", "--as", "leica-tmac", "--joints", "@pj.csv"],
        ["@messy.csv", "--robot", "irb1600"],
        ["@messy.csv"],
    )
    out = ["--dry-run"] if random.random() < 0.2 else ["--out", ">m.csv"]
    return ["import", *random.choice(calls), *out, *_some(random, ["--json"])]


def _iso9283(random: Random) -> list[str]:
    calls = (
        ["@cycles.csv", "--calibration", "@cal", "--target", "smr1"],
        ["@cycles.csv", "--commanded", "@commanded.csv", "--target", "smr1"],
        ["@cycles.csv", "--calibration", "@cal", "--target", "smr1", "--approaches", "@approach.csv"],
        ["@cycles.csv", "--calibration", "@cal", "--target", "smr1", "--path", "@path.csv", "--commanded-path", "@commanded_path.csv"],
        ["--plan", "@robot.urdf"],
    )  # fmt: skip
    return ["iso9283", *random.choice(calls), *_some(random, ["--json"])]


def _tracker(random: Random) -> list[str]:
    name = random.choice(("bar", "repeat", "drift", "settle"))
    length = ["--length", "1000"] if name == "bar" else []
    plot = ["--plot", random.choice((">t.svg", ">t.png"))] if random.random() < 0.15 else []
    return ["tracker", f"@{name}.csv", *length, *plot, *_some(random, ["--json"], ["--check", name])]


def _ballbar(random: Random) -> list[str]:
    plot = ["--plot", ">b.svg"] if random.random() < 0.1 else []
    options = ["--bar", "150", "--tool", "0,65,149", "--joints", "10,0,0,0,90,0"]
    return ["ballbar", "@cal", "@ball.csv", *options, *plot, *_some(random, ["--json"], ["--arcs", "2"])]


def _joints(random: Random) -> list[str]:
    return [
        "joints",
        "@m.csv",
        *_some(random, ["--json"], ["--joint", "1"], ["--order", "3"], ["--calibration", "@cal"]),
    ]


def _simulate(random: Random) -> list[str]:
    robot = random.choice(("irb1600", "@robot.urdf", "@small.urdf"))
    more = _some(
        random, ["--json"], ["--tracker", "3000,0,500"], ["--wait", "1"], ["--payload", "2"], ["--targets", "2"]
    )
    if random.random() < 0.2:
        device = ["--device", random.choice(("ball", "sockets", "plane", "string")), "--random", "12"]
        return ["simulate", "--robot", robot, *device, "--out", ">sim.csv", *_some(random, ["--json"])]
    return ["simulate", "@j.csv", "--robot", robot, "--out", ">sim.csv", *more]


def _plan(random: Random) -> list[str]:
    robot = random.choice(("@robot.urdf", "@small.urdf"))
    more = ["--axis", "0", "--cube", "0", "--all-range", "4"]
    return ["plan", "--robot", robot, "--out", ">plan", *more, *_some(random, ["--json"], ["--targets", "@t.csv"])]


def _urdf(random: Random) -> list[str]:
    convention = random.choice(("modified", "standard"))
    return ["urdf", "--dh", "@dh.csv", "--convention", convention, "--out", ">arm.urdf", *_some(random, ["--json"], ["--name", "a b"])]  # fmt: skip


def _controller(random: Random) -> list[str]:
    robot = random.choice(("irb120", "@robot.urdf"))
    return ["controller", "@c.csv", "--robot", robot, *_some(random, ["--json"], ["--out", ">arm.urdf"])]


def _export(random: Random) -> list[str]:
    calibration = random.choice(("@cal", "@cal-map", "@cal-auto"))
    target = random.choice(("cpp", "python", "urdf", "mujoco", "drake", "ros"))
    more = _some(
        random, ["--json"], ["--without-frame-terms"], ["--mesh-paths", "package"], ["--without-meshes"], _load(random)
    )
    return ["export", calibration, "--as", target, "--out", ">exported", *more]


def _stream(random: Random) -> list[str]:
    more = _some(random, ["--at", "0,0,0,0,30,0"], ["--units", "rad"], _load(random))
    return ["stream", random.choice(("@cal", "@cal-map", "@cal-auto")), *more, "--without-frame-terms", "<s.jsonl"]


def _fleet(random: Random) -> list[str]:
    json = _some(random, ["--json"])
    return random.choice(
        (
            ["fleet", "calibrate", "@fleet.csv", "--out", ">fleet", "--jobs", "1", *json],
            [
                "fleet",
                "add",
                "@cal",
                "--store",
                ">new.db",
                *json,
                *_some(random, ["--id", "a"], ["--date", "2026-03-02"], ["--jobs", "1"]),
            ],
            [
                "fleet",
                "list",
                "--store",
                "@fleet.db",
                *json,
                *_some(random, ["--report", ">fleet.html", "--tolerance", "0.2"]),
            ],
            ["fleet", "drift", *_some(random, ["a"]), "--store", "@type.db", *json],
            ["fleet", "export", "--store", "@fleet.db", "--out", ">parameters.csv", *_what(random)],
            ["fleet", "prior", "--type", "irb1600_6_145", "--store", "@type.db", "--out", ">prior.json", *json],
            ["calibrate", "@m.csv", "--robot", "irb1600", "--prior", "@prior.json", "--out", ">typed", *json],
        )
    )


def _what(random: Random) -> list[str]:
    return _some(random, ["--what", random.choice(("robots", "calibrations", "files"))])


def _circles(random: Random) -> list[str]:
    if random.random() < 0.3:
        return ["axes", "@m.csv", *_some(random, ["--json"])]
    more = _some(random, ["--json"], ["--parallel", "forced"], ["--part", "base"], ["--tolerance", "1"])
    return ["circles", "@m.csv", "--robot", "irb1600", *more]


def _hand_eye(random: Random) -> list[str]:
    words = ["hand-eye", "@pictures.csv", "--images", "@pictures", "--features", "@board.csv"]
    more = _some(random, ["--out", ">hand_eye.json"], ["--json"], ["--as", "easy_handeye2"])
    if random.random() < 0.4:
        return ["hand-eye", "@cell.samples", *more]
    return [*words, *random.choice(([], ["--robot", _robot(random)])), *more]


def _corners(random: Random) -> list[str]:
    words = ["corners", "@pictures", "--joints", "@pictures.csv", "--features", "@board.csv", "--out", ">corners.csv"]
    return [*words, *_some(random, ["--json"])]


def _lens(random: Random) -> list[str]:
    form = random.choice(("features", "ros", "opencv", "kalibr"))
    return [
        "lens",
        "@pictures",
        "--features",
        "@board.csv",
        "--as",
        form,
        *_some(random, ["--out", ">lens"], ["--json"]),
    ]


def _app(random: Random) -> list[str]:
    """A port that cannot be, so that none serves for ever."""
    return ["app", random.choice(("@cal", "@m.csv", ">project")), "--no-open", "--port", "70000"]


def _samples(random: Random) -> list[str]:
    return ["samples", random.choice((">samples", "@m.csv", "@cal")), *_some(random, ["--json"])]


def _demo(random: Random) -> list[str]:
    return ["demo", "--out", ">demo", "--model", random.choice(("16", "x")), *_some(random, ["--json"], ["--force"])]


def _robots(random: Random) -> list[str]:
    return ["robots", *_some(random, ["--json"], ["--nothing"])]


MAKERS: list[tuple[Maker, int]] = [
    (_fk, 10), (_ik, 5), (_filter, 34), (_verify, 10), (_evaluate, 8), (_calibrate, 1), (_view, 3), (_report, 1),
    (_import, 14), (_iso9283, 8), (_tracker, 12), (_ballbar, 3), (_joints, 2), (_simulate, 4), (_plan, 1),
    (_robots, 1), (_urdf, 3), (_controller, 3), (_compare, 2), (_export, 4), (_stream, 6), (_fleet, 8),
    (_circles, 2), (_corners, 2), (_lens, 2), (_hand_eye, 2), (_samples, 1), (_demo, 1), (_cell, 5), (_sign, 1),
    (_app, 1),
]  # fmt: skip
NAMES = (
    "-",
    "--json",
    "--",
    "a\nb.csv",
    "é𝒳.csv",
    "x" * 300,
    "a" * 250 + ".csv",
    "",
    "nan",
    ".",
    "/",
    "con:0",
    "\x01.csv",
)


def made(random: Random, good: Path, folder: Path) -> list[str]:
    """Write the inputs of a case into a folder; returns the words of the command line.

    Parameters
    ----------
    random : Random
    good : Path
        The good inputs.
    folder : Path
        Of the case; it is the current one when the command runs.
    """
    makers, weights = zip(*MAKERS, strict=True)
    words = random.choices(makers, weights)[0](random)
    inputs = [word[1:] for word in words if word[:1] in "@<" and word]
    for name in inputs:
        _copy(good, folder, name)
    target = random.choice(inputs) if inputs else None
    kind = random.random()
    place: dict[str, str] = {}
    if target is not None and kind < 0.80:
        _damage(folder, target, random)
    elif target is not None and kind < 0.92 and f"<{target}" not in words:
        place[target] = _elsewhere(folder, target, random)
    else:
        words = _option(words, random)
    return [place.get(word[1:], word[1:]) if word[:1] in "@>" and word else word for word in words]


def _copy(good: Path, folder: Path, name: str) -> None:
    if (good / name).is_dir():
        shutil.copytree(good / name, folder / name, dirs_exist_ok=True)
    elif (good / name).exists():
        shutil.copyfile(good / name, folder / name)
    else:  # a language without a sample
        (folder / name).write_bytes(b"")


def _damage(folder: Path, name: str, random: Random) -> None:
    path = folder / name
    if name.startswith("jobs-"):
        path = random.choice(sorted(path.iterdir()))
        name = f"{name[5:]}{path.suffix}"
    elif name == "pictures":
        path = path / "1.png"
    elif path.is_dir():
        path = path / random.choice(("calibration.json",) * 6 + ("calibrated.urdf",))
    stem = name.partition(".")[0]
    language = stem if stem in corpus.endings() else None
    words = corpus.words(language) if language else []
    data = path.read_bytes()
    if language and (not data or random.random() < 0.05):
        data = b"\n".join(random.choices(words, k=random.choice((3, 10, 30)))) if words else b"x"
    kind = "text" if language and path.suffix != ".csv" else KINDS.get(path.suffix, "text")
    path.write_bytes(damaged(data, kind, random, words))


def _elsewhere(folder: Path, name: str, random: Random) -> str:
    """Something that is no good file in an input's place, or a good one of a strange name; returns its name."""
    path = folder / name
    kind = random.randrange(9)
    if kind >= 6:
        new = random.choice(NAMES)
        try:
            if new not in ("", ".", "/") and not os.path.exists(folder / new):
                path.rename(folder / new)
        except OSError:
            pass
        return new
    if kind == 5:
        return random.choice(("/dev/null", "/dev/zero", "/dev/tty", "/proc/self/mem", "/proc/self/environ"))
    if name.startswith("jobs-"):
        path = random.choice(sorted(path.iterdir()))
    elif name == "pictures":
        path = path / "1.png"
    elif path.is_dir():
        path = path / random.choice(("calibration.json", "calibrated.urdf"))
    path.unlink(missing_ok=True)
    if kind == 0:
        path.mkdir()
    elif kind == 1:
        os.mkfifo(path)
    elif kind == 2:
        path.symlink_to(path)
    elif kind == 3:
        path.write_bytes(b"")
    return name


def _option(words: list[str], random: Random) -> list[str]:
    """Another value of an option, a word lost, or a word more."""
    spots = range(1, len(words))
    kind = random.randrange(5)
    if not spots:
        return words
    k = random.choice(spots)
    value = random.choice(NUMBERS if random.random() < 0.7 else TEXTS).replace("\x00", "")
    if kind == 0:
        return words[:k] + words[k + 1 :]
    if kind == 1:
        return [*words, random.choice(("--json", "--out", value, "--seed", "-x", "--plot", "--height", "--band"))]
    if kind == 2 and words[k][:1] not in "@>" and "," in words[k]:
        parts = words[k].split(",")
        parts[random.randrange(len(parts))] = random.choice(NUMBERS)
        return [*words[:k], ",".join(parts), *words[k + 1 :]]
    return [*words[:k], value[:100_000], *words[k + 1 :]]
