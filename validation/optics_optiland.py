"""Per-ray agreement of `retina optics trace` with Optiland and rayoptics, and their speed side by side.

The prescriptions are read here from the same TOML files, glass indices are computed here from
assets/optics/glasses.csv and handed to both programs, and rays are launched here: only the tracing of the
three is compared. Writes the frozen vectors of retina-optics/tests (--write), and a report
(schema retina.validation-optics/1) to out/optics/report.json.

    out/venv-optics/bin/python validation/optics_optiland.py [--retina PATH] [--write] [--speed]
"""

import argparse
import csv
import json
import math
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
ASSETS = ROOT / "assets" / "optics"
TESTS = ROOT / "retina-optics" / "tests" / "data"
SYSTEMS = [
    ASSETS / "reference-1.0fc-wide.toml",
    ASSETS / "reference-1.3fc-wide.toml",
    ASSETS / "reference-1.3fc-narrow.toml",
    ASSETS / "reference-1.5fc-narrow.toml",
    ASSETS / "cooke-triplet.toml",
    ASSETS / "double-gauss.toml",
    TESTS / "asphere.toml",
]
PUPIL = [(0.0, 0.0), (0.0, 0.95), (0.0, -0.95), (0.7, 0.0), (-0.5, 0.5), (0.3, -0.8)]


def rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


GLASSES = {row["glass"]: row for row in rows(ASSETS / "glasses.csv")}
DOUBLETS = {row["part"]: row for row in rows(ASSETS / "doublets.csv")}


def index(glass, nm):
    """n relative to air from the coefficients of the asset."""
    row, l2 = GLASSES[glass], (nm * 1e-3) ** 2
    c = [float(x) for x in row["coefficients"].split()]
    if row["formula"] == "sellmeier":
        return math.sqrt(1 + sum(b * l2 / (l2 - k) for b, k in zip(c[0::2], c[1::2])))
    return math.sqrt(c[0] + sum(a * (nm * 1e-3) ** e for a, e in zip(c[1::2], c[2::2])))


class System:
    """A prescription: surfaces as dictionaries of radius, conic, terms, thickness, glass and tilt."""

    def __init__(self, path):
        data = tomllib.loads(path.read_text())
        self.path, self.name = path, data["name"]
        self.wavelengths = [w["nm"] for w in data["wavelength"]]
        primary = [i for i, w in enumerate(data["wavelength"]) if w.get("primary")]
        self.primary = primary[0] if primary else len(self.wavelengths) // 2
        self.fields = [(f.get("x_tan", 0.0), f.get("y_tan", 0.0)) for f in data["field"]]
        self.surfaces, self.groups = [], {}
        for entry in data["surface"]:
            first = len(self.surfaces)
            if entry.get("stop"):
                self.stop = first
            self.surfaces += self.expand(entry)
            if "group" in entry:
                self.groups.setdefault(entry["group"], []).extend(range(first, len(self.surfaces)))
        for group in data.get("group", []):
            members = self.groups[group["name"]]
            # A group of one surface, tilted about x alone: conventions of turn order do not enter.
            assert len(members) == 1 and group.get("pivot_mm", 0) == 0 and group["tilt_deg"][1:] == [0, 0]
            self.surfaces[members[0]]["tilt_x"] = math.radians(group["tilt_deg"][0])
            self.surfaces[members[0]]["decentre"] = group["decentre_mm"]
        beam = data["beam"]
        a, b = self.to_stop()
        self.pupil_z = b / a
        self.pupil_radius = beam.get("entrance_pupil_mm", self.efl() / beam.get("f_number", 1)) / 2

    @staticmethod
    def expand(entry):
        if "part" not in entry:
            keys = {"radius": entry.get("radius_mm"), "conic": entry.get("conic", 0.0), "terms": entry.get("aspheric")}
            return [keys | {"thickness": entry.get("thickness_mm", 0.0), "glass": entry.get("glass")}]
        lens = DOUBLETS[entry["part"]]
        radii = [float(lens[f"radius_{i}_mm"]) if lens[f"radius_{i}_mm"] else None for i in (1, 2, 3)]
        thickness = [float(lens[f"thickness_{i}_mm"]) for i in (1, 2)]
        glasses = [lens["glass_1"], lens["glass_2"]]
        if entry.get("reversed"):
            radii = [-r if r else None for r in reversed(radii)]
            thickness, glasses = thickness[::-1], glasses[::-1]
        gaps, media = thickness + [entry.get("thickness_mm", 0.0)], glasses + [None]
        return [{"radius": r, "conic": 0.0, "terms": None, "thickness": t, "glass": g} for r, t, g in zip(radii, gaps, media)]

    def indices(self, nm):
        return [index(s["glass"], nm) if s["glass"] else 1.0 for s in self.surfaces]

    def paraxial(self, y, nu, count):
        n, out = [1.0] + self.indices(self.wavelengths[self.primary]), []
        for i, surface in enumerate(self.surfaces[:count]):
            if i:
                y += self.surfaces[i - 1]["thickness"] * nu / n[i]
            c = 1 / surface["radius"] if surface["radius"] else 0.0
            c += 2 * (surface["terms"][0] if surface["terms"] else 0.0)
            out.append(y)
            nu -= y * (n[i + 1] - n[i]) * c
        return out, nu

    def to_stop(self):
        return [self.paraxial(y, nu, self.stop + 1)[0][-1] for y, nu in ((1.0, 0.0), (0.0, 1.0))]

    def efl(self):
        return -1 / self.paraxial(1.0, 0.0, len(self.surfaces) - 1)[1]

    def launch(self, field, pupil):
        """Point on the plane of the paraxial entrance pupil, moved to z = -20 mm, and direction cosines."""
        d = np.array([field[0], field[1], 1.0])
        p = np.array([pupil[0] * self.pupil_radius, pupil[1] * self.pupil_radius, self.pupil_z])
        p = p + d * (-20.0 - p[2])
        return p, d / np.linalg.norm(d)


def optiland_model(system, nm):
    import optiland.backend as be
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    optic = Optic()
    optic.surfaces.add(index=0, radius=be.inf, thickness=be.inf)
    for i, (surface, n) in enumerate(zip(system.surfaces, system.indices(nm))):
        keys = {"radius": surface["radius"] or be.inf, "conic": surface["conic"]}
        if surface["terms"]:
            # Its iteration would stop at 1e-10 mm otherwise.
            keys |= {"surface_type": "even_asphere", "coefficients": surface["terms"], "tol": 1e-14, "max_iter": 200}
        if "tilt_x" in surface:
            dx, dy, dz = surface["decentre"]
            keys |= {"rx": surface["tilt_x"], "dx": dx, "dy": dy}
            assert dz == 0  # Optiland would move what follows as well
        last = i + 1 == len(system.surfaces)
        thickness = {} if last else {"thickness": surface["thickness"]}
        medium = {} if last else {"material": IdealMaterial(n) if surface["glass"] else "air"}
        optic.surfaces.add(index=i + 1, is_stop=i == system.stop, **keys, **thickness, **medium)
    optic.set_aperture(aperture_type="EPD", value=2 * system.pupil_radius)
    optic.fields.set_type(field_type="angle")
    optic.fields.add(y=0)
    optic.wavelengths.add(value=nm * 1e-3, is_primary=True)
    return optic


def optiland_trace(optic, starts, directions, nm):
    from optiland.rays import RealRays

    p, d = np.array(starts).T, np.array(directions).T
    one = np.ones(p.shape[1])
    rays = RealRays(*p, *d, one, nm * 1e-3 * one)
    optic.surfaces.trace(rays, skip=1)
    return np.array([rays.x, rays.y, rays.L, rays.M, rays.N, rays.opd]).T


def rayoptics_trace(system, starts, directions, nm):
    from rayoptics.elem.profiles import Conic, EvenPolynomial, Spherical
    from rayoptics.raytr.raytrace import trace_raw
    from rayoptics.seq.gap import Gap
    from rayoptics.elem.surface import Surface

    n = [1.0] + system.indices(nm)
    eye, path = np.identity(3), []
    thickness = [20.0] + [s["thickness"] for s in system.surfaces]
    entries = [{"radius": None, "conic": 0.0, "terms": None}] + system.surfaces
    if any("tilt_x" in s for s in system.surfaces):
        return None
    for i, surface in enumerate(entries):
        c = 1 / surface["radius"] if surface["radius"] else 0.0
        if surface["terms"]:
            profile = EvenPolynomial(c=c, cc=surface["conic"], coefs=surface["terms"])
        elif surface["conic"]:
            profile = Conic(c=c, cc=surface["conic"])
        else:
            profile = Spherical(c=c)
        last = i + 1 == len(entries)
        gap = None if last else Gap(thickness[i])
        path.append([Surface(profile=profile), gap, (eye, np.array([0.0, 0.0, thickness[i]])), n[i], 1.0])
    out = []
    for start, direction in zip(starts, directions):
        local = np.array([start[0], start[1], 0.0])
        ray, _, _ = trace_raw(iter(path), local, np.array(direction), nm, intersect_obj=False)
        length = sum(n[i] * ray[i][2] for i in range(len(ray) - 1))
        out.append([ray[-1][0][0], ray[-1][0][1], *ray[-1][1], length])
    return np.array(out)


def retina_trace(program, system, field, pupil, nm):
    command = [program, "optics", "trace", str(system.path), "--unclipped", "--json", f"--wavelength-nm={nm}"]
    command += [f"--field={field[0]!r},{field[1]!r}", f"--pupil={pupil[0]!r},{pupil[1]!r}"]
    last = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["crossings"][-1]
    # The image is neither tilted nor decentred in these systems.
    return [*last["local_mm"][:2], *last["direction"], last["path_mm"]]


def compare(program, write):
    vectors, report = [], []
    for path in SYSTEMS:
        system = System(path)
        worst = {"optiland": [0.0, 0.0, 0.0], "rayoptics": [0.0, 0.0, 0.0]}
        count = 0
        for nm in system.wavelengths:
            optic = optiland_model(system, nm)
            for field in system.fields:
                launched = [system.launch(field, pupil) for pupil in PUPIL]
                starts, directions = [p for p, _ in launched], [d for _, d in launched]
                # Paths count from the wavefront through the first vertex.
                extra = np.array([p @ d for p, d in launched])
                others = {"optiland": optiland_trace(optic, starts, directions, nm)}
                other = rayoptics_trace(system, starts, directions, nm)
                if other is not None:
                    others["rayoptics"] = other
                for traced in others.values():
                    traced[:, 5] += extra
                for i, pupil in enumerate(PUPIL):
                    vectors.append([path.stem, nm, *field, *pupil, *others["optiland"][i]])
                    count += 1
                    if program:
                        ours = np.array(retina_trace(program, system, field, pupil, nm))
                        for name, traced in others.items():
                            error = np.abs(ours - traced[i])
                            new = [error[:2].max(), error[2:5].max(), error[5]]
                            worst[name] = [max(a, b) for a, b in zip(worst[name], new)]
                    elif other is not None:
                        error = np.abs(others["optiland"][i] - other[i])
                        new = [error[:2].max(), error[2:5].max(), error[5]]
                        worst["rayoptics"] = [max(a, b) for a, b in zip(worst["rayoptics"], new)]
        for name, (position, direction, length) in worst.items():
            if position == direction == length == 0:  # not compared: a tilt, or --write
                continue
            against = name if program else f"{name} and optiland"
            print(f"{system.name:24} {against:12} {count:4} rays: {position:.1e} mm, {direction:.1e}, path {length:.1e} mm")
            report.append({"system": system.name, "against": against, "rays": count, "position_mm": position, "direction": direction, "path_mm": length})
    if write:
        with open(TESTS / "optiland_rays.csv", "w") as file:
            file.write("# Rays on the image traced by Optiland 0.6.0 (numpy, float64); written by validation/optics_optiland.py.\n")
            file.write("system,wavelength_nm,field_x,field_y,pupil_x,pupil_y,x_mm,y_mm,l,m,n,path_mm\n")
            for row in vectors:
                file.write(",".join(v if isinstance(v, str) else repr(float(v)) for v in row) + "\n")
    return report


def speed():
    """Optiland's rays x surfaces per CPU second, for the bench trace_rate to be held against."""
    from optiland.rays import RealRays

    report = []
    for path in (ASSETS / "reference-1.3fc-wide.toml", ASSETS / "cooke-triplet.toml"):
        system = System(path)
        nm = system.wavelengths[system.primary]
        optic = optiland_model(system, nm)
        best = 0.0
        for count in (2048, 20_000, 200_000):
            angle, radius = np.random.default_rng(1).random((2, count))
            pupil = zip(np.sqrt(radius) * np.cos(6.2832 * angle), np.sqrt(radius) * np.sin(6.2832 * angle))
            launched = [system.launch(system.fields[1], p) for p in pupil]
            starts, directions = [p for p, _ in launched], [d for _, d in launched]
            for _ in range(5):
                p, d = np.array(starts).T, np.array(directions).T
                one = np.ones(count)
                rays = RealRays(*p, *d, one, nm * 1e-3 * one)
                start = time.process_time()
                optic.surfaces.trace(rays, skip=1)
                best = max(best, count * len(system.surfaces) / (time.process_time() - start))
        print(f"{system.name}: Optiland {best:.3e} rays x surfaces / CPU s")
        report.append({"system": system.name, "optiland_rays_surfaces_per_s": best})
    return report


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--retina", default=str(ROOT / "target" / "release" / "retina"))
    parser.add_argument("--write", action="store_true", help="write the frozen vectors of the tests, comparing Optiland with rayoptics alone")
    parser.add_argument("--speed", action="store_true")
    arguments = parser.parse_args()
    report = {"schema": "retina.validation-optics/1"}
    report["rays"] = compare(None if arguments.write else arguments.retina, arguments.write)
    if arguments.speed:
        report["speed"] = speed()
    out = ROOT / "out" / "optics"
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    if not arguments.write and any(r["position_mm"] > 1e-9 or r["path_mm"] > 1e-9 for r in report["rays"]):
        sys.exit("validation: a ray is off by more than 1e-9 mm")


if __name__ == "__main__":
    main()
