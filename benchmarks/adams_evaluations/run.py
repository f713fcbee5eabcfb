"""Function evaluations of DEABM and of SciPy's Adams codes at equal tolerance.

Run with the package and its extra ``bench`` installed:
``python benchmarks/adams_evaluations/run.py``.
"""

import csv
from collections.abc import Callable
from math import cos, hypot, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import ode, solve_ivp

import holonom

HERE = Path(__file__).parent
MODELS = HERE / "../../models"
TOLERANCES = [1e-4, 1e-6, 1e-8]
ALLOWED_RATIO = 1.5

Vector = NDArray[np.float64]
Rate = Callable[[float, Vector], Vector]


class Counted:
    """A right-hand side that counts its calls."""

    def __init__(self, rate: Rate) -> None:
        self.rate, self.calls = rate, 0

    def __call__(self, t: float, y: Vector) -> Vector:
        """Evaluate once more."""
        self.calls += 1
        return self.rate(t, y)


def pendulum(_: float, y: Vector) -> Vector:
    """Angle from the horizontal and its rate; length 1 m."""
    return np.array([y[1], -9.81 * cos(y[0])])


class Andrews:
    """Andrews' mechanism in the crank angle, after the Test Set for IVP Solvers.

    The six other angles follow from the loops by Newton's method, their rates and accelerations by
    linear equations.
    """

    m = (0.04325, 0.00365, 0.02373, 0.00706, 0.0705, 0.00706, 0.05498)
    i = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
    start = -0.0617138900142764496

    def __init__(self) -> None:
        self.dependent = np.array(
            [
                0.0,
                0.45527981916307,
                0.22266839016589,
                0.48736497954384,
                -0.22266839016589,
                1.2305474445498,
            ]
        )

    def loops(self, q: Vector) -> tuple[Vector, Vector]:
        """Residual of the loops and its Jacobian."""
        be, th, ga, ph, de, om, ep = q
        rr, d, ss, e, zt, zf, u = 0.007, 0.028, 0.035, 0.02, 0.04, 0.02, 0.04
        s1, c1, s2, c2 = sin(be), cos(be), sin(be + th), cos(be + th)
        s3, c3, s4, c4 = sin(ga), cos(ga), sin(ph + de), cos(ph + de)
        s5, c5, s6, c6, s7, c7 = sin(de), cos(de), sin(om + ep), cos(om + ep), sin(ep), cos(ep)
        x, y = rr * c1 - d * c2, rr * s1 - d * s2
        residual = np.array(
            [
                x - ss * s3 + 0.03635,
                y + ss * c3 - 0.03273,
                x - e * s4 - zt * c5 + 0.06934,
                y + e * c4 - zt * s5 + 0.00227,
                x - zf * c6 - u * s7 + 0.06934,
                y - zf * s6 + u * c7 + 0.00227,
            ]
        )
        g = np.zeros((6, 7))
        g[0::2, 0], g[0::2, 1] = -rr * s1 + d * s2, d * s2
        g[1::2, 0], g[1::2, 1] = rr * c1 - d * c2, -d * c2
        g[0, 2], g[1, 2] = -ss * c3, -ss * s3
        g[2, 3], g[2, 4] = -e * c4, -e * c4 + zt * s5
        g[3, 3], g[3, 4] = -e * s4, -e * s4 - zt * c5
        g[4, 5], g[4, 6] = zf * s6, zf * s6 - u * c7
        g[5, 5], g[5, 6] = -zf * c6, -zf * c6 - u * s7
        return residual, g

    def curvature(self, q: Vector, v: Vector) -> Vector:
        """(G v)_q v."""
        be, th, ga, ph, de, om, ep = q
        rr, d, ss, e, zt, zf, u = 0.007, 0.028, 0.035, 0.02, 0.04, 0.02, 0.04
        a, b, c, f, g, h, k = v[0], v[0] + v[1], v[2], v[3] + v[4], v[4], v[5] + v[6], v[6]
        x = -rr * cos(be) * a**2 + d * cos(be + th) * b**2
        y = -rr * sin(be) * a**2 + d * sin(be + th) * b**2
        return np.array(
            [
                x + ss * sin(ga) * c**2,
                y - ss * cos(ga) * c**2,
                x + e * sin(ph + de) * f**2 + zt * cos(de) * g**2,
                y - e * cos(ph + de) * f**2 + zt * sin(de) * g**2,
                x + zf * cos(om + ep) * h**2 + u * sin(ep) * k**2,
                y + zf * sin(om + ep) * h**2 - u * cos(ep) * k**2,
            ]
        )

    def mass_and_force(self, q: Vector, v: Vector) -> tuple[Vector, Vector]:
        """Mass matrix and forces of the open tree."""
        _, th, ga, ph, _, om, _ = q
        bep, thp, _, php, dep, omp, epp = v
        m1, m2, m3, m4, m5, m6, m7 = self.m
        i1, i2, i3, i4, i5, i6, i7 = self.i
        rr, da, ra, sa, sb, sc, sd = 0.007, 0.0115, 0.00092, 0.01874, 0.01043, 0.018, 0.02
        ta, tb, u, ua, ub, zt = 0.02308, 0.00916, 0.04, 0.01228, 0.00449, 0.04
        b, w = 0.02 - 0.01421, 0.02 - 0.01421  # e − ea, zf − fa
        m = np.zeros((7, 7))
        m[0, 0] = m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * cos(th) + da**2) + i1 + i2
        m[0, 1] = m[1, 0] = m2 * (da**2 - da * rr * cos(th)) + i2
        m[1, 1] = m2 * da**2 + i2
        m[2, 2] = m3 * (sa**2 + sb**2) + i3
        m[3, 3] = m4 * b**2 + i4
        m[3, 4] = m[4, 3] = m4 * (b**2 + zt * b * sin(ph)) + i4
        m[4, 4] = m4 * (zt**2 + 2 * zt * b * sin(ph) + b**2) + m5 * (ta**2 + tb**2) + i4 + i5
        m[5, 5] = m6 * w**2 + i6
        m[5, 6] = m[6, 5] = m6 * (w**2 - u * w * sin(om)) + i6
        m[6, 6] = m6 * (w**2 - 2 * u * w * sin(om) + u**2) + m7 * (ua**2 + ub**2) + i6 + i7
        dx = sd * cos(ga) + sc * sin(ga) - 0.03635 - 0.014
        dy = sd * sin(ga) - sc * cos(ga) + 0.03273 - 0.072
        length = hypot(dx, dy)
        tension = -4530.0 * (length - 0.07785) / length
        fx, fy = tension * dx, tension * dy
        force = np.array(
            [
                0.033 - m2 * da * rr * thp * (thp + 2 * bep) * sin(th),
                m2 * da * rr * bep**2 * sin(th),
                fx * (sc * cos(ga) - sd * sin(ga)) + fy * (sd * cos(ga) + sc * sin(ga)),
                m4 * zt * b * dep**2 * cos(ph),
                -m4 * zt * b * php * (php + 2 * dep) * cos(ph),
                -m6 * u * w * epp**2 * cos(om),
                m6 * u * w * omp * (omp + 2 * epp) * cos(om),
            ]
        )
        return m, force

    def __call__(self, _: float, y: Vector) -> Vector:
        """Rate of the crank angle and of its velocity."""
        q = np.concatenate([y[:1], self.dependent])
        for _ in range(20):
            residual, g = self.loops(q)
            correction = np.linalg.solve(g[:, 1:], residual)
            q[1:] -= correction
            if np.abs(correction).max() < 1e-13:
                break
        self.dependent = q[1:].copy()
        _, g = self.loops(q)
        d = np.concatenate([[1.0], -np.linalg.solve(g[:, 1:], g[:, 0])])
        v = d * y[1]
        s = np.concatenate([[0.0], -np.linalg.solve(g[:, 1:], self.curvature(q, v))])
        m, force = self.mass_and_force(q, v)
        return np.array([y[1], d @ (force - m @ s) / (d @ m @ d)])


def vode(rate: Rate, y: Vector, end: float, tolerance: float) -> tuple[int, float]:
    """Calls and end angle of VODE's Adams formulas with functional iteration."""
    counted = Counted(rate)
    solver = ode(counted).set_integrator(
        "vode", method="adams", rtol=tolerance, atol=tolerance, nsteps=1_000_000
    )
    solver.set_initial_value(y, 0.0)
    solver.integrate(end)
    assert solver.successful()
    return counted.calls, float(solver.y[0])


def lsoda(rate: Rate, y: Vector, end: float, tolerance: float) -> tuple[int, float]:
    """Calls and end angle of LSODA, which may change to backward differences."""
    counted = Counted(rate)
    result = solve_ivp(counted, (0.0, end), y, method="LSODA", rtol=tolerance, atol=tolerance)
    assert result.success
    return counted.calls, float(result.y[0, -1])


def deabm(model: holonom.Model, angle: str, end: float, tolerance: float) -> tuple[int, float]:
    """Evaluations and end angle of DEABM on the constrained model."""
    result = model.simulate(
        method="DEABM", end_time=end, tolerance=tolerance, interval=end, channels=[angle]
    )
    return result.statistics.evaluations, float(result[angle][-1])


def main() -> None:
    """Count, compare, write results.csv."""
    cases = [
        ("simple_pendulum", "bob.angle", 10.0, lambda: pendulum, np.array([0.0, 0.0])),
        ("andrews", "K1.angle", 0.03, Andrews, np.array([Andrews.start, 0.0])),
    ]
    rows = []
    for name, angle, end, rate, start in cases:
        model = holonom.Model.load(MODELS / name / "model.toml")
        exact = solve_ivp(rate(), (0.0, end), start, method="DOP853", rtol=1e-13, atol=1e-13).y[
            0, -1
        ]
        for tolerance in TOLERANCES:
            ours, our_end = deabm(model, angle, end, tolerance)
            theirs, their_end = vode(rate(), start, end, tolerance)
            switching, switching_end = lsoda(rate(), start, end, tolerance)
            row = {
                "model": name,
                "tolerance": tolerance,
                "DEABM": ours,
                "VODE": theirs,
                "LSODA": switching,
                "DEABM/VODE": ours / theirs,
                "DEABM/LSODA": ours / switching,
                "error DEABM": abs(our_end - exact),
                "error VODE": abs(their_end - exact),
                "error LSODA": abs(switching_end - exact),
            }
            rows.append(row)
            print(
                {k: f"{v:.3g}" if isinstance(v, float) else v for k, v in row.items()}, flush=True
            )
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.3g}" if isinstance(v, float) else v for k, v in row.items()})
    worst = max(row["DEABM/VODE"] for row in rows)
    print(f"largest ratio DEABM/VODE: {worst:.2f}")
    assert worst <= ALLOWED_RATIO, f"more than {ALLOWED_RATIO} times the evaluations of VODE"


if __name__ == "__main__":
    main()
