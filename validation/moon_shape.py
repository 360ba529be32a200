"""The shipped Moon against the elevation map that it is built from, and what its limb measures.

Reads the map (16 bit, plate carree, longitude 0..360 deg from left to right, north up, metres = sample - 10000 above
1737.4 km) and assets/bodies/moon.glb, and checks highest and lowest points, the offset of the centre of figure, seas and
craters at their places (a mirrored Moon fails), and the mesh's heights against the map's. Then it draws views at random,
takes the limb's profile of each, and fits a circle to the half on the Sun's side: by so much the terrain moves a limb's
radius and centre. It also says by what turns of the view and of the Sun's side
that error changes: `terrain_tilt_deg` and `terrain_roll_deg` of the full-disk filter. The map's first row, at the north pole, holds samples of 2573 to 10 799 m among those of about 0: it
is replaced by the second row here, and with --mend in a copy of the map, from which the body is built. Exit code 0 done, 1 a check fails, 2 bad input.
"""

import argparse
import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import common
from common import say

RADIUS_M = common.MOON_RADIUS_M
# Name, east longitude, latitude (deg; IAU Gazetteer), and whether it is a sea.
PLACES = [
    ("Mare Imbrium", -15.6, 32.8, True),
    ("Mare Crisium", 59.1, 17.0, True),
    ("Mare Humorum", -38.6, -24.4, True),
    ("Mare Nectaris", 34.6, -15.2, True),
    ("Tycho's rays and highlands", -11.2, -43.3, False),
    ("Far side highlands", -158.6, 5.3, False),
]


def direction(longitude_deg, latitude_deg):
    """Unit vectors, last axis x y z."""
    lon, lat = np.radians(longitude_deg), np.radians(latitude_deg)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


class Map:
    """Heights in metres by direction, averaged over blocks of pixels."""

    def __init__(self, path, block):
        Image.MAX_IMAGE_PIXELS = None
        samples = np.array(Image.open(path)).astype(float) - 10_000.0
        self.full = samples
        samples[0] = samples[1]
        rows, columns = samples.shape
        if columns != 2 * rows:
            raise SystemExit(f"{path}: {columns} x {rows} pixels are no plate carree map of a whole body")
        self.height_m = samples.reshape(rows // block, block, columns // block, block).mean((1, 3))

    def at(self, unit, full=False):
        height = self.full if full else self.height_m
        rows, columns = height.shape
        lon = np.arctan2(unit[..., 1], unit[..., 0]) % (2 * np.pi)
        lat = np.arcsin(np.clip(unit[..., 2], -1, 1))
        x = np.minimum((lon / (2 * np.pi) * columns).astype(int), columns - 1)
        y = np.minimum(((0.5 - lat / np.pi) * rows).astype(int), rows - 1)
        return height[y, x]

    def centre_offset_m(self):
        """3 <h n> over the sphere: the centre of figure of a shape r = R + h, to first order."""
        rows, columns = self.height_m.shape
        lat = 90.0 - (np.arange(rows) + 0.5) * 180.0 / rows
        lon = (np.arange(columns) + 0.5) * 360.0 / columns
        unit = direction(*np.meshgrid(lon, lat))
        weight = np.cos(np.radians(lat))[:, None] * np.ones(columns)
        return 3.0 * (unit * (self.height_m * weight)[..., None]).sum((0, 1)) / weight.sum()


def vertices_and_tones(path):
    """Positions of all vertices (m) and the linear albedo of the texture there."""
    glb = common.Glb(path)
    document = glb.document
    places, tones = [], []
    for primitive in document["meshes"][0]["primitives"]:
        material = document["materials"][primitive["material"]]["pbrMetallicRoughness"]
        image = document["images"][document["textures"][material["baseColorTexture"]["index"]]["source"]]
        pixels = np.array(Image.open(io.BytesIO(glb.view(image["bufferView"]))).convert("L")) / 255.0
        uv = glb.accessor(primitive["attributes"]["TEXCOORD_0"])
        places.append(glb.accessor(primitive["attributes"]["POSITION"]).astype(float))
        tones.append(common.bilinear_clamped(common.srgb_to_linear(pixels), uv))
    return np.concatenate(places), np.concatenate(tones).reshape(-1)


class Limbs:
    """Circles through half limbs."""

    def __init__(self, relief, step_deg, depth_step_deg):
        self.relief = relief
        self.angle = np.arange(0.0, 2 * np.pi, np.radians(step_deg))
        # Terrain within 8 deg of the limb's plane may stand above it: 17 km of height at the edge.
        self.depth = np.radians(np.arange(-8.0, 8.01, depth_step_deg))

    def fit(self, towards, right, sun):
        """Radius and centre (towards the Sun, across) of the circle through the half on the side `sun`, and the mean of
        the whole limb, m."""
        up = np.cross(towards, right)
        rim = np.cos(self.angle)[:, None] * right + np.sin(self.angle)[:, None] * up
        unit = np.cos(self.depth)[:, None, None] * rim + np.sin(self.depth)[:, None, None] * towards
        profile = ((RADIUS_M + self.relief.at(unit)) * np.cos(self.depth)[:, None]).max(0) - RADIUS_M
        lit = np.cos(self.angle - sun) > 0.17
        angle = self.angle[lit] - sun
        rows = np.stack([np.ones(lit.sum()), np.cos(angle), np.sin(angle)], axis=1)
        return [*np.linalg.lstsq(rows, profile[lit], rcond=None)[0], profile.mean()]


def view(random):
    """A direction at random, one across it, and where the Sun stands about it."""
    towards, other = random.normal(size=(2, 3))
    towards /= np.linalg.norm(towards)
    right = np.cross(towards, other)
    return towards, right / np.linalg.norm(right), random.uniform(0, 2 * np.pi)


def limb_statistics(relief, draws, seed):
    """Mean and standard deviation of radius and centre (towards the Sun, across) of circles through half limbs, m."""
    random = np.random.default_rng(seed)
    limbs = Limbs(relief, 0.5, 0.25)
    fits = np.array([limbs.fit(*view(random)) for _ in range(draws)])
    return fits.mean(0), fits.std(0)


def limb_turns(relief, draws, seed):
    """Angles (deg) at which the correlation of a half limb's fit with the former one has fallen to 1/e, for its radius and
    its centre (towards the Sun, across): where the line of sight turns about an axis across it, and where the Sun's side
    turns about the line of sight."""
    random = np.random.default_rng(seed)
    limbs = Limbs(relief, 1.0, 0.5)
    turns = np.arange(0.0, 91.0, 5.0)
    tilted, rolled = [], []
    for _ in range(draws):
        towards, right, sun = view(random)
        about = random.uniform(0, 2 * np.pi)
        axis = np.cos(about) * right + np.sin(about) * np.cross(towards, right)

        def turned(vector, turn):
            along = axis * (axis @ vector) * (1 - np.cos(turn))
            return vector * np.cos(turn) + np.cross(axis, vector) * np.sin(turn) + along

        tilted.append([limbs.fit(turned(towards, t), turned(right, t), sun)[:3] for t in np.radians(turns)])
        rolled.append([limbs.fit(towards, right, sun + t)[:3] for t in np.radians(turns)])
    angles = []
    for fits in (np.array(tilted), np.array(rolled)):
        off = fits - fits.mean((0, 1))
        correlations = (off * off[:, :1]).mean(0) / (off[:, 0] ** 2).mean(0)
        below = lambda c: int(np.argmax(c < np.exp(-1))) or len(c) - 1
        at = lambda c, k: np.interp(-np.exp(-1), -c[k - 1 : k + 1], turns[k - 1 : k + 1])
        angles.append([at(c, below(c)) for c in correlations.T])
    return angles


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dem", type=Path, required=True, help="elevation map")
    parser.add_argument("--body", type=Path, default=common.ROOT / "assets/bodies/moon.glb")
    parser.add_argument("--mend", type=Path, metavar="FILE.png", help="write the map with its first row mended, and end")
    parser.add_argument("--draws", type=int, default=2000)
    arguments = parser.parse_args()
    relief = Map(arguments.dem, 4)
    if arguments.mend:
        Image.fromarray((relief.full + 10_000.0).astype(np.uint16)).save(arguments.mend)
        return 0
    vertices, tone = vertices_and_tones(arguments.body)
    radius = np.linalg.norm(vertices, axis=1)
    unit, height = vertices / radius[:, None], radius - RADIUS_M
    bad = []

    def check(fits, text):
        say(("ok    " if fits else "FAILS ") + text)
        if not fits:
            bad.append(text)

    full, coarse = relief.full, Map(arguments.dem, 6)
    for name, pick, lon0, lat0, expected in [
        ("highest", np.argmax, 201.34, 5.34, 10_714.0),
        ("lowest", np.argmin, 187.5, -70.4, -8_967.0),
    ]:
        row, column = np.unravel_index(pick(full), full.shape)
        lon, lat = (column + 0.5) * 360 / full.shape[1], 90 - (row + 0.5) * 180 / full.shape[0]
        off = np.degrees(np.arccos(np.clip(direction(lon, lat) @ direction(lon0, lat0), -1, 1)))
        found = full[row, column]
        text = f"{name} point of the map: {found:.0f} m at {lat:.2f} N {lon:.2f} E; {expected:.0f} m is right"
        check(abs(found - expected) < 100 and off < 1.0, text)
        near = unit @ direction(lon0, lat0) > np.cos(np.radians(0.5))
        # A vertex has the mean over its cell of 11 km.
        wide = pick(coarse.at(unit[near])), pick(height[near])
        mean, there = coarse.at(unit[near])[wide[0]], height[near][wide[1]]
        text = f"{name} vertex of the mesh within 0.5 deg of it: {there:.0f} m; the map's means over 11 km: {mean:.0f} m"
        check(abs(there - mean) < 500, text)
    # LOLA's: Smith et al. (2017), The global topography of the Moon, Icarus 283.
    expected = np.array([-1775.2, -731.3, 239.9])
    offset = relief.centre_offset_m()
    text = f"centre of figure of the map {np.round(offset)} m ({np.linalg.norm(offset):.0f} m); LOLA {expected}"
    check(np.linalg.norm(offset - expected) < 60, text)
    error = height - relief.at(unit)
    mirrored = height - relief.at(unit * [1, -1, 1])
    text = (
        f"heights of {len(unit)} vertices less the map's: {error.mean():.0f} +- {error.std():.0f} m (mirrored "
        f"+- {mirrored.std():.0f} m)"
    )
    check(error.std() < 250 and abs(error.mean()) < 20 and mirrored.std() > 1500, text)
    for name, lon, lat, sea in PLACES:
        near = unit @ direction(lon, lat) > np.cos(np.radians(2.0))
        bright = tone[near].mean() / tone.mean()
        low = relief.at(direction(lon, lat))
        mesh = height[np.argmax(unit @ direction(lon, lat))]
        text = f"{name}: tone {bright:.2f} of the mean, {low:.0f} m by the map, {mesh:.0f} m by the mesh"
        check((bright < 0.85) == sea and abs(low - mesh) < 700, text)
    mean, spread = limb_statistics(relief, arguments.draws, 1)
    say(
        f"half limbs of {arguments.draws} random views: radius {mean[0]:+.0f} +- {spread[0]:.0f} m, centre towards the Sun "
        f"{mean[1]:+.0f} +- {spread[1]:.0f} m, across {mean[2]:+.0f} +- {spread[2]:.0f} m; whole limb {mean[3]:+.0f} +- "
        f"{spread[3]:.0f} m"
    )
    tilt, roll = limb_turns(Map(arguments.dem, 8), arguments.draws, 1)
    for what, (radius, sunwards, across) in (("view", tilt), ("Sun's side", roll)):
        say(
            f"a half limb's fit is correlated by 1/e with that of a {what} turned by {radius:.0f} deg (radius), "
            f"{sunwards:.0f} deg (centre towards the Sun), {across:.0f} deg (centre across)"
        )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
