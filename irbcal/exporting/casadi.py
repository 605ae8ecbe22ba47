"""CasADi: joint map, its inverse, the tip and derivatives as Functions for optimal control, and as generated C."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from irbcal import literals
from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import ExportFiles, RobotNumbers, Vectors, constants, render
from irbcal.exporting.source import Source, required_package

DESCRIPTION = "CasADi: Functions of joint map, inverse, tip and Jacobians, saved and as generated C"
NEXT_STEP = "python {folder}/{word}_casadi.py     # are its numbers right here, too?"
INVERSE_STEPS = 14
"""Of the way back from effective to commanded joints: each leaves less than a tenth of what was missed."""
SITUATION = {"previous": None, "known": 1, "payload_kg": 1, "payload_centre": 3}
"""Inputs beside the joints, and how many numbers each has (None: one a joint)."""


def files(source: Source) -> ExportFiles:
    """Saved Functions, C code, and a module that loads and checks them."""
    ca = required_package("casadi", "casadi")
    numbers = source.numbers
    by_name = functions(numbers, source.vectors)
    word = f"{numbers.identifier}_casadi"
    out = {}
    with TemporaryDirectory() as folder:
        generator = ca.CodeGenerator(f"{word}.c", {"with_header": True})
        for name, function in by_name.items():
            function.save(f"{folder}/{name}.casadi")
            out[f"{name}.casadi"] = Path(folder, f"{name}.casadi").read_bytes()
            generator.add(function)
        generator.generate(f"{folder}/")
        for ending in ("c", "h"):
            head = (
                f"/* {literals.comment(f'{numbers.name}, {numbers.version}, calibration {numbers.fingerprint}')} */\n"
            )
            out[f"{word}.{ending}"] = head.encode() + Path(folder, f"{word}.{ending}").read_bytes()
    values = {
        "constants": constants(numbers, source.vectors),
        "names": list(by_name),
        "inputs": list(_inputs(numbers)),
        "usual": [
            [numbers.proportional[name][0]] * n for name, n in _inputs(numbers).items() if name in numbers.proportional
        ],
    }
    return ExportFiles(out | {f"{word}.py": render("casadi.py.j2", numbers, source.vectors, **values)})


def functions(numbers: RobotNumbers, vectors: Vectors) -> dict[str, Any]:
    """The Functions by their names.

    The formulas are those of the exported module on plain floats, given symbols in place of numbers.

    Returns
    -------
    dict of str to casadi.Function
        ``effective``, ``effective_jacobian``, ``commanded``, ``tip`` (4 by 4), ``tip_jacobian``.
    """
    ca = required_package("casadi", "casadi")
    robot: Any = Plain(**constants(numbers, vectors), functions=ca, _size=_size)
    sizes = _inputs(numbers)
    q = ca.SX.sym("q", len(numbers.joint_names))
    symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    moves = ca.vertsplit(symbols["known"] * (q - symbols["previous"])) if numbers.has_history else None
    n = len(numbers.joint_names)
    readings = {
        name: ca.vertsplit(symbols[name]) * (n // sizes[name]) for name in sizes if name in numbers.proportional
    }
    load = symbols["payload_kg"], ca.vertsplit(symbols["payload_centre"])
    theta = q + ca.vertcat(*robot._shift(ca.vertsplit(q), moves, *load, readings))
    R, p, columns = robot._geometric(ca.vertsplit(theta))
    T = ca.vertcat(ca.horzcat(*(ca.vertcat(*column) for column in (*R, p))), ca.SX([[0, 0, 0, 1]]))
    map_jacobian = ca.jacobian(theta, q)
    J = ca.horzcat(*(ca.vertcat(*column) for column in columns)) @ map_jacobian
    inputs, names = [q, *symbols.values()], ["q", *symbols]
    by_name = {
        name: ca.Function(name, inputs, [value], names, [said])
        for name, value, said in (
            ("effective", theta, "theta"),
            ("effective_jacobian", map_jacobian, "dtheta_dq"),
            ("tip", T, "T_base_tip"),
            ("tip_jacobian", J, "J"),
        )
    }
    effective = ca.MX.sym("theta", len(numbers.joint_names))
    situation = [ca.MX.sym(name, size) for name, size in sizes.items()]
    q_symbol = effective
    for _ in range(INVERSE_STEPS):
        q_symbol = q_symbol + (effective - by_name["effective"](q_symbol, *situation))
    by_name["commanded"] = ca.Function("commanded", [effective, *situation], [q_symbol], ["theta", *sizes], ["q"])
    return by_name


def _inputs(numbers: RobotNumbers) -> dict[str, int]:
    """Names and sizes of the inputs beside the joints; torques and their like where they matter."""
    n = len(numbers.joint_names)
    sizes = {name: n if size is None else size for name, size in SITUATION.items()}
    return sizes | {name: n if each else 1 for name, (_, turned, each) in numbers.proportional.items() if turned.any()}


def _size(moves: list[Any]) -> Any:
    """The largest move, one where nothing moves."""
    ca = required_package("casadi", "casadi")
    largest = ca.fabs(moves[0])
    for move in moves[1:]:
        largest = ca.fmax(largest, ca.fabs(move))
    return largest + (largest == 0.0)
