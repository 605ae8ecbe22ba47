"""Names of the commands and what the list of them says: listing loads none of them."""

PANELS: dict[str, dict[str, str]] = {
    "Calibrate": {
        "demo": "Calibrate a simulated IRB 1600 with the shipped measurements and prove it on 1,000 other poses.",
        "import": "Turn files of other programs into a measurement file.",
        "corners": "Find the corners of a ChArUco board in pictures: rows for calibrate --features.",
        "hand-eye": "Where cameras and boards are on the flange and in the cell, the robot taken as it is.",
        "calibrate": "Identify a robot, prove it on held-out poses, write a folder with URDF, JSON, YAML and report.",
        "evaluate": (
            "Mean, sigma, max and mean + 3 sigma per group, target and payload, for the nominal and the "
            "calibrated robot."
        ),
        "compare": (
            "Compare calibrations of one robot pose by pose: which is better, and whether that is beyond chance."
        ),
        "view": (
            "Look at the robot, measured and modelled points and magnified errors, pose by pose (served on "
            "127.0.0.1 only)."
        ),
        "fleet": (
            "Many robots, many years: calibrate by a list, keep in a store, see what changed and which stand out."
        ),
        "report": "Write report.html again from calibration.json; its figures (PNG, SVG) and data (CSV) on request.",
    },
    "Prepare": {
        "robots": "List the robots that --robot takes by name.",
        "urdf": "Write a URDF from a Denavit-Hartenberg table, for robots that have none.",
        "plan": (
            "Plan measurements: poses that the robot reaches and the tracker sees, a robot program, and what they "
            "promise."
        ),
        "simulate": (
            "Measure with a virtual robot, tool and laser tracker: SIMULATED data for trying out plans and "
            "calibrations."
        ),
        "samples": "Write small example files for every command, all SIMULATED, with the lines that try them.",
    },
    "Use": {
        "fk": (
            "Where a robot really ends: poses of the tip in the base link (mm, unit quaternion, scalar first), as CSV."
        ),
        "ik": (
            "Joints to command so that a robot reaches poses of its tip, as CSV; empty joints and a note where it "
            "cannot."
        ),
        "cell": (
            "Compute tools and work objects with the calibrated robot from touches, and how far off the "
            "controller's are."
        ),
        "filter": "Replace a program's targets so that the controller with its nominal model reaches the true poses.",
        "export": "Write the calibrated robot as a part of other programs, with test vectors and fingerprint inside.",
        "stream": (
            "Correct wanted joints or poses, a line of JSON each, as they come; bring the arm to rest where one is "
            "not safe."
        ),
        "verify": (
            "Tell whether a calibration is as it was written, or a URDF or program its own; exit code 1 if it is not."
        ),
        "sign": (
            "Sign a calibration folder or a certificate with a laboratory's key; irbcal verify --public-key checks it."
        ),
    },
    "Validate": {
        "joints": "Backlash, Fourier series, gains and stiffness joint by joint, and which of them this robot needs.",
        "circles": "Base, tool and links of a robot by the circles of one-joint moves alone.",
        "axes": "Backlash, Fourier series, gains and stiffness joint by joint, and which of them this robot needs.",
        "controller": (
            "Compare a URDF with the poses that the controller itself reports: which lengths and zeros it "
            "computes with."
        ),
        "iso9283": (
            "Accuracy, repeatability, drift, settling, velocity, corners, posing time, compliance, after ISO 9283:1998."
        ),
        "tracker": "Scale-bar distances, repeatability, long-term drift with the air, stabilisation time.",
        "ballbar": (
            "Radial errors of a circle as a ballbar shows them: nominal targets, fake targets, measured; joint "
            "reversals."
        ),
    },
}
"""Commands in the groups of the list, with the first paragraph of what each says of itself."""
COMMANDS = tuple(name for names in PANELS.values() for name in names)
ELSEWHERE = {
    "import": ("import_", "import_files"),
    "filter": ("filter", "filter_program"),
    "hand-eye": ("hand_eye", "hand_eye"),
    "axes": ("joints", "joints"),
}
"""Module and function of commands that are not the function of their name in the module of their name."""
GROUPS = {"fleet"}
"""Names that have commands of their own behind them: their module has a Typer ``app``."""
HIDDEN = {"axes"}
"""Names of before, which still work."""
