"""Angles on the sky, for the validation programs of stars."""

import numpy as np


def apart_arcsec(one, other):
    """Great-circle distance of two answers of `retina navigate stars`, by `ra_deg` and `dec_deg`, arcsec."""
    def unit(answer):
        ra, dec = np.radians([answer["ra_deg"], answer["dec_deg"]])
        return np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    a, b = unit(one), unit(other)
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)) * 3600)
