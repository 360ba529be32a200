//! Cubics between the values of a table.

/// Shares of the values before, at, after and two after a place, `t` in 0 to 1 between the middle ones: cubic with Catmull
/// and Rom's slopes (R. G. Keys, IEEE Trans. Acoust. Speech Signal Process. 29, 1153 (1981), a = -1/2).
pub fn cubic_shares(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t + 2.0 * t2 - t3),
        0.5 * (2.0 - 5.0 * t2 + 3.0 * t3),
        0.5 * (t + 4.0 * t2 - 3.0 * t3),
        0.5 * (t3 - t2),
    ]
}
