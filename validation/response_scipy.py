"""The radiometric calibration of `retina calibrate radiometry` against scipy on the same tables.

Draws campaigns of a power meter with numpy (a display of known gamma and black, a meter with a zero), writes
them as power.csv, and compares what `retina` finds with scipy.optimize.least_squares on the same rows: gamma,
full, black, zero in units of their standard deviations, the standard deviations themselves, the curve at every
count, and eqs. 9 and 10 (efficiencies, bandwidth) by scipy.integrate.quad. Exit code 1 beyond the tolerances.
Report: out/response/report.json (schema retina.validation-response/1).

    validation/.venv/bin/python validation/response_scipy.py [--retina PATH] [--campaigns N]
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.integrate import quad
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parent.parent
SETUP = ROOT / "assets" / "setups" / "wide-fov.toml"
# red, green, blue: full (W m^-2 a pixel), gamma, black, meter zero (W m^-2)
TRUTH = {"r": (2.1e-8, 2.23, 2e-4, 4e-6), "g": (2.4e-8, 2.18, 1.5e-4, 5e-6), "b": (1.4e-8, 2.20, 3e-4, 6e-6)}
WAVELENGTH_NM = {"r": 605.0, "g": 544.0, "b": 475.0}
FLOOR_W_M2, PROPORTIONAL = 1e-7, 0.004
# The curve of the paper's camera, as retina-radiometry/src/efficiency.rs has it.
QE = np.array([
    (297, 0.046335), (347, 0.21472), (397, 0.46362), (447, 0.63806), (497, 0.66967), (547, 0.68317),
    (597, 0.62862), (647, 0.56362), (697, 0.46565), (747, 0.35428), (797, 0.26281), (847, 0.16923),
    (897, 0.10733), (947, 0.057816), (997, 0.028469), (1047, 0.011971)])
# Two programs that minimise one sum of squares differ by their stopping rules alone.
MOST_SIGMAS, MOST_RELATIVE_SIGMA, MOST_CURVE_SIGMAS = 0.02, 0.02, 0.02
MOST_EFFICIENCY = 1e-4


def plan():
    rows = [(0, 0)] * 6
    for step in range(31):
        count = round(255 * (step / 30) ** 1.42)
        rows += [(count, n) for n in ((400, 800) if count < 40 else (100, 200))]
    return rows


def light(parameters, count):
    full, gamma, black, _ = parameters
    x = np.asarray(count, float) / 255
    return full * ((1 - black) * x**gamma + black)


def campaign(random, path):
    """Writes a table; returns its rows by channel as arrays (count, N, reading, sigma)."""
    tables, lines = {}, ["channel,digital_count,square_px,irradiance_w_m2,sigma_w_m2"]
    for channel, truth in TRUTH.items():
        rows = []
        for count, n in plan():
            lit = n * n * light(truth, count)
            sigma = math.hypot(FLOOR_W_M2, PROPORTIONAL * lit)
            reading = float(lit + truth[3] + sigma * random.standard_normal())
            rows.append((count, n, reading, sigma))
            lines.append(f"{channel},{count},{n},{reading!r},{sigma!r}")
        tables[channel] = np.array(rows)
    path.write_text("\n".join(lines) + "\n")
    return tables


def scipy_fit(rows):
    """Parameters (ln of full, gamma, black, zero in units of 1e-6) and their covariance."""
    count, n, reading, sigma = rows.T

    def residual(p):
        values = (math.exp(p[0]), p[1], p[2], 0.0)
        return (n * n * light(values, count) + p[3] * 1e-6 - reading) / sigma

    found = least_squares(residual, [math.log(1e-8), 2.0, 1e-4, 0.0], x_scale="jac", method="lm",
                          xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


def curve_sigma(p, covariance, count):
    """One standard deviation of I(count), from numerical derivatives."""
    def value(q):
        return light((math.exp(q[0]), q[1], q[2], 0.0), count)
    steps = 1e-4 * np.sqrt(np.diag(covariance))
    row = np.array([(value(p + d) - value(p - d)) / (2 * s) for d, s in zip(np.diag(steps), steps)])
    return math.sqrt(row @ covariance @ row)


def efficiencies():
    def qe_times_wavelength(nm):
        return np.interp(nm, QE[:, 0], QE[:, 1], 0.0, 0.0) * nm
    peak = max(qe_times_wavelength(nm) for nm in np.arange(297, 1047, 0.01))
    area = sum(quad(qe_times_wavelength, a, b)[0] for a, b in zip(QE[:-1, 0], QE[1:, 0]))
    return {c: qe_times_wavelength(nm) / peak for c, nm in WAVELENGTH_NM.items()}, area / peak


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--retina", default=ROOT / "target" / "release" / "retina")
    parser.add_argument("--campaigns", type=int, default=20)
    arguments = parser.parse_args()
    out = ROOT / "out" / "response"
    out.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    worst = {"parameter_sigmas": 0.0, "relative_sigma": 0.0, "curve_sigmas": 0.0, "efficiency": 0.0}
    compared, truth_off = 0, []
    left_out = {"with_outliers": 0, "with_more_knots": 0, "with_raised_sigmas": 0}
    eta, bandwidth = efficiencies()
    for k in range(arguments.campaigns):
        table = out / f"power-{k}.csv"
        tables = campaign(random, table)
        command = [arguments.retina, "calibrate", "radiometry", "--setup", SETUP, "--data", table, "--json"]
        found = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        for c, eta_c in eta.items():
            worst["efficiency"] = max(worst["efficiency"], abs(found["channels"][c]["efficiency"] / eta_c - 1))
        worst["efficiency"] = max(worst["efficiency"], abs(found["bandwidth_nm"] / bandwidth - 1))
        for c, rows in tables.items():
            ours = found["channels"][c]
            # scipy is given the plain least squares: other rows, another curve or other sigmas are no comparison
            reasons = (bool(ours["outliers"]), ours["knots"] > 2, any("scatter" in w for w in ours["warnings"]))
            for key, reason in zip(left_out, reasons):
                left_out[key] += reason
            if any(reasons):
                continue
            p, covariance = scipy_fit(rows)
            sigma = np.sqrt(np.diag(covariance))
            theirs = [(math.exp(p[0]), math.exp(p[0]) * sigma[0]), (p[1], sigma[1]), (p[2], sigma[2]),
                      (p[3] * 1e-6, sigma[3] * 1e-6)]
            keys = ["full_w_m2", "gamma", "black", "zero_w_m2"]
            for key, (value, s), truth in zip(keys, theirs, TRUTH[c]):
                mine = ours[key]
                worst["parameter_sigmas"] = max(worst["parameter_sigmas"], abs(mine["value"] - value) / s)
                worst["relative_sigma"] = max(worst["relative_sigma"], abs(mine["sigma"] / s - 1))
                truth_off.append((mine["value"] - truth) / mine["sigma"])
            for count in (0, 1, 2, 5, 10, 30, 80, 160, 255):
                s = curve_sigma(p, covariance, count)
                value = light((math.exp(p[0]), p[1], p[2], 0.0), count)
                off = abs(ours["response"]["irradiance_w_m2"][count] - value) / s
                worst["curve_sigmas"] = max(worst["curve_sigmas"], off)
                worst["relative_sigma"] = max(
                    worst["relative_sigma"], abs(ours["response"]["sigma_w_m2"][count] / s - 1))
            compared += 1
    truth_off = np.array(truth_off)
    report = {
        "schema": "retina.validation-response/1", "campaigns": arguments.campaigns, "compared_channels": compared,
        "left_out_channels": left_out, "worst": worst,
        "truth": {"rms_sigmas": float(np.sqrt(np.mean(truth_off**2))),
                  "within_90_percent": float(np.mean(np.abs(truth_off) < 1.64485))},
    }
    (out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    print(json.dumps(report, indent=1))
    limits = (MOST_SIGMAS, MOST_RELATIVE_SIGMA, MOST_CURVE_SIGMAS, MOST_EFFICIENCY)
    return int(compared == 0 or any(value > limit for value, limit in zip(worst.values(), limits)))


if __name__ == "__main__":
    sys.exit(main())
