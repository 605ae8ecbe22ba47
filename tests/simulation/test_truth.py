"""What the cell says that it hides is what it does."""

from dataclasses import replace

import numpy as np

from irbcal.modeling import frames
from irbcal.units import DEG, MM


def test_parameters_of_the_truth_make_the_true_points_again(cell):
    """Base, targets, link errors and joint map from the truth's numbers alone, without effects."""
    bare = cell.only()
    values = bare.truth()["parameters"]
    q = cell.arm.random_joints(20, seed=6)
    table = cell.arm.table
    for column, unit in (("alpha", DEG), ("a", MM), ("theta", DEG), ("d", MM)):
        errors = [values.get(f"delta_{column}{j}", 0.0) * unit for j in range(1, 7)]
        table = replace(table, **{column: getattr(table, column) + errors})
    theta = q.copy()
    A, B = (values[f"stiffness_{name}"] * DEG for name in "AB")
    theta[:, 1] += A * np.sin(q[:, 1]) + B * np.cos(q[:, 1] + q[:, 2])
    theta[:, 2] += B * np.cos(q[:, 1] + q[:, 2])
    waves = [np.cos(q[:, 5]), np.sin(q[:, 5]), np.cos(2 * q[:, 5]), np.sin(2 * q[:, 5])]
    theta[:, 5] += sum(values[f"fourier_{n}"] * DEG * w for n, w in zip(("a1", "b1", "a2", "b2"), waves, strict=True))
    T = cell.arm.with_table(table).forward(theta)
    base = frames.from_xyz_angles(
        [values[f"base_{n}"] * (DEG if "r" in n else MM) for n in ("x", "y", "z", "rx", "ry", "rz")]
    )
    for k, name in enumerate(cell.tool.names):
        local = np.array([values[f"target_{name}_{axis}"] for axis in "xyz"]) * MM
        np.testing.assert_allclose(
            bare.measure(q).xyz[:, k], frames.apply(base, T[:, :3, :3] @ local + T[:, :3, 3]), rtol=0, atol=1e-8
        )
