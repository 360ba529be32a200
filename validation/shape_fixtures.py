"""Writes the shapes that tests of retina-model read: an ICQ ellipsoid, and DSK kernels by CSPICE's dskw02.

    V/bin/python validation/shape_fixtures.py        # requirements-spice.txt

The ellipsoid has the semi-axes 3, 2 and 1.5 km. In ICQ form a cube of q = 6 is projected on it. As plates it has
vertices on a grid of longitude and latitude; one kernel has them in one segment, another in two (north and south, with
a comment area before them), one has plates that wind clockwise.
"""

from pathlib import Path

import numpy as np
import spiceypy as spice

FOLDER = Path(__file__).resolve().parent.parent / "retina-model/tests/shapes"
AXES_KM = np.array([3.0, 2.0, 1.5])
# Axes of the faces: outward, columns, rows. Gaskell's faces are not all of one sense either.
FACES = [
    ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    ((-1, 0, 0), (0, -1, 0), (0, 0, -1)),
    ((0, 1, 0), (-1, 0, 0), (0, 0, -1)),
    ((1, 0, 0), (0, 1, 0), (0, 0, -1)),
    ((0, 0, -1), (0, 1, 0), (-1, 0, 0)),
]


def write_icq(path, q):
    lines = [str(q)]
    for outward, across, down in FACES:
        for row in range(q + 1):
            for column in range(q + 1):
                u, v = (2.0 * column / q - 1.0), (2.0 * row / q - 1.0)
                place = np.array(outward) + u * np.array(across) + v * np.array(down)
                x, y, z = AXES_KM * place / np.linalg.norm(place)
                lines.append(f"{x:13.7f}{y:13.7f}{z:13.7f}")
    path.write_text("\n".join(lines) + "\n")


def ellipsoid(lines, columns, from_deg, to_deg):
    """Vertices (km) and plates (from 1) between two latitudes."""
    vertices, plates = [], []
    for row in range(lines + 1):
        latitude = np.radians(from_deg + (to_deg - from_deg) * row / lines)
        for column in range(columns):
            longitude = 2.0 * np.pi * column / columns
            # Without negative zeros and rounding at the poles, so that seams meet.
            place = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
            vertices.append(np.round(AXES_KM * place, 9) + 0.0)
    for row in range(lines):
        for column in range(columns):
            here, right = row * columns + column, row * columns + (column + 1) % columns
            up, across = here + columns, right + columns
            plates += [[here, right, across], [here, across, up]]
    # Plates at the poles have no area: CSPICE refuses them.
    vertices = np.array(vertices)
    return vertices, np.array([
        [corner + 1 for corner in plate] for plate in plates
        if np.linalg.norm(np.cross(*(vertices[plate[k]] - vertices[plate[0]] for k in (1, 2)))) > 1e-12
    ])


def write_dsk(path, segments, comment=()):
    path.unlink(missing_ok=True)
    handle = spice.dskopn(str(path), "ellipsoid", 200 if comment else 0)
    if comment:
        spice.dasac(handle, list(comment))
    for vertices, plates in segments:
        doubles, integers = spice.dskmi2(vertices, plates, 5.0, 2, 10_000, 10_000, 40_000, True, 200_000)
        spice.dskw02(
            handle, 2000433, 1, 2, "IAU_EROS", 1, np.zeros(10), -np.pi, np.pi, -np.pi / 2.0, np.pi / 2.0, 0.1, 10.0,
            -1e9, 1e9, vertices, plates, doubles, integers,
        )
    spice.dskcls(handle, True)


def main():
    FOLDER.mkdir(exist_ok=True)
    write_icq(FOLDER / "ellipsoid.icq", 6)
    whole = ellipsoid(6, 8, -90.0, 90.0)
    write_dsk(FOLDER / "ellipsoid.bds", [whole])
    write_dsk(FOLDER / "clockwise.bds", [(whole[0], whole[1][:, ::-1].copy())])
    halves = [ellipsoid(3, 8, -90.0, 0.0), ellipsoid(3, 8, 0.0, 90.0)]
    write_dsk(FOLDER / "halves.bds", halves, ["A comment before the segments."] * 20)


if __name__ == "__main__":
    main()
