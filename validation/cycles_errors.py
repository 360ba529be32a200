"""Errors of one renderer against another, over crops whose limb is known and over whole discs."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Piece:
    """One crop: the reference, its two halves, coverage, and which pixels are near the limb."""

    phase_deg: int
    place: str
    box: list
    reference: np.ndarray
    half_difference: np.ndarray
    alpha: np.ndarray
    limb: np.ndarray
    interior: np.ndarray


def cut(image, box):
    x, y, width, height = box
    return image[y : y + height, x : x + width].astype(np.float64)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def shift_px(differences):
    """The shift that explains most of the differences, to first order: a check of the pose."""
    slopes, values = [], []
    for difference, piece in differences:
        down, along = np.gradient(piece.reference)
        inner = piece.interior
        slopes.append(np.stack([along[inner], down[inner]], axis=1))
        values.append(difference[inner])
    fit = np.linalg.lstsq(np.concatenate(slopes), -np.concatenate(values), rcond=None)[0]
    return [float(v) for v in fit]


def errors(pieces, images):
    """Errors of one renderer against the reference, all crops pooled; `images` by phase as
    (I/F, coverage) of the whole frame."""
    pairs = [(cut(images[p.phase_deg][0], p.box), cut(images[p.phase_deg][1], p.box), p) for p in pieces]
    inside = [(value[p.interior], p.reference[p.interior]) for value, _, p in pairs]
    product = sum(float((v * r).sum()) for v, r in inside)
    gain = product / sum(float((v * v).sum()) for v, _ in inside)
    differences = [(gain * value - p.reference, p) for value, _, p in pairs]
    mean = mean_reference(pieces)

    def pooled(select):
        return np.concatenate([d[select(p)] for d, p in differences])

    everything = pooled(lambda p: p.limb | p.interior)
    magnitude = np.abs(everything)
    coverage = np.concatenate([(c - p.alpha)[p.limb] for _, c, p in pairs])
    return {
        "gain": gain,
        "shift_px": shift_px(differences),
        "rms": rms(everything),
        "rms_interior": rms(pooled(lambda p: p.interior)),
        "rms_limb": rms(pooled(lambda p: p.limb)),
        "percentiles": {str(q): float(np.percentile(magnitude, q)) for q in (50, 90, 95, 99, 99.9)},
        "max": float(magnitude.max()),
        "mean_interior": float(pooled(lambda p: p.interior).mean()),
        "mean_limb": float(pooled(lambda p: p.limb).mean()),
        "rms_coverage_limb": rms(coverage),
        "mean_coverage_limb": float(coverage.mean()),
        "mean_reference": mean,
        "pixels": len(everything),
        "pixels_limb": len(coverage),
        "by_crop": {
            f"{p.phase_deg} {p.place}": {
                "rms_interior": rms(d[p.interior]),
                "rms_limb": rms(d[p.limb]),
                "mean_reference": float(p.reference[p.interior | p.limb].mean()),
            }
            for d, p in differences
        },
    }


def mean_reference(pieces):
    return float(np.concatenate([p.reference[p.limb | p.interior] for p in pieces]).mean())


def reference_noise(pieces):
    """rms of half the difference of the reference's halves: the noise of their mean."""

    def pooled(select):
        return rms(np.concatenate([p.half_difference[select(p)] for p in pieces]))

    return {
        "rms": pooled(lambda p: p.limb | p.interior),
        "rms_interior": pooled(lambda p: p.interior),
        "rms_limb": pooled(lambda p: p.limb),
    }


def against_whole_discs(images, truth):
    """rms and gain against another rendering, over all pixels of the body."""
    value = np.concatenate([images[p][0][truth[p][1] > 0] for p in truth]).astype(np.float64)
    other = np.concatenate([truth[p][0][truth[p][1] > 0] for p in truth]).astype(np.float64)
    gain = float((value * other).sum() / (value * value).sum())
    difference = np.abs(gain * value - other)
    return {
        "gain": gain,
        "rms": rms(difference),
        "percentiles": {str(q): float(np.percentile(difference, q)) for q in (50, 95, 99, 99.9)},
        "max": float(difference.max()),
        "mean_reference": float(other.mean()),
    }
