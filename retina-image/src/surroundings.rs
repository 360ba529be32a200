//! Whether a spot stands alone or on an edge.

use crate::candidates::nine;
use crate::{Background, CameraImage};

/// Places on the ring about a spot.
const PLACES: usize = 16;
/// The ring's radius: spot widths, and pixels on top.
const RING_SIGMAS: f64 = 4.0;
const RING_PX: f64 = 2.0;
/// Of the spot's 3 x 3 light over the ring's darker part: places that have more are bright themselves.
const BRIGHT_SHARE: f64 = 0.35;
/// And by so many standard deviations of a 3 x 3 sum.
const BRIGHT_SIGMAS: f64 = 2.5;

/// What surrounds a spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Surroundings {
    /// Share that is nearly as bright as the spot: none about a star in the dark, half of it on the edge of a roof.
    pub(crate) bright_share: f64,
    /// Two opposite places are: a line passes through the spot.
    pub(crate) line: bool,
}

/// Looks at sixteen 3 x 3 sums on a ring about a spot. What is dark is their fourth darkest one, so that the mesh of the
/// background does not matter.
pub(crate) fn surroundings(
    image: &CameraImage,
    background: &Background,
    centre_px: [f64; 2],
    spot_sigma_px: f64,
    reach_px: f64,
) -> Surroundings {
    let dark_ones = Surroundings { bright_share: 0.0, line: false };
    let [width, height] = [f64::from(image.width_px), f64::from(image.height_px)];
    let sum = |at: [f64; 2]| {
        let inside = at[0] >= 1.0 && at[1] >= 1.0 && at[0] < width - 1.0 && at[1] < height - 1.0;
        inside.then(|| nine(image, at[0] as usize, at[1] as usize))
    };
    let Some(own) = sum(centre_px) else { return dark_ones };
    let radius = RING_SIGMAS * spot_sigma_px + RING_PX + reach_px;
    let ring: [Option<f64>; PLACES] = std::array::from_fn(|k| {
        let (sin, cos) = (k as f64 * std::f64::consts::TAU / PLACES as f64).sin_cos();
        sum([centre_px[0] + radius * cos, centre_px[1] + radius * sin])
    });
    let mut inside: Vec<f64> = ring.into_iter().flatten().collect();
    if inside.len() < PLACES / 2 {
        return dark_ones;
    }
    inside.sort_by(f64::total_cmp);
    let noise = 3.0 * background.alike() * background.noise_dn(centre_px[0], centre_px[1]);
    let dark = inside[inside.len() / 4];
    let limit = dark + (BRIGHT_SHARE * (own - dark)).max(BRIGHT_SIGMAS * noise);
    let bright = ring.map(|light| light.is_some_and(|light| light > limit));
    let opposite = |k: usize| [7, 8, 9].into_iter().any(|half| bright[(k + half) % PLACES]);
    Surroundings {
        bright_share: bright.iter().filter(|bright| **bright).count() as f64 / inside.len() as f64,
        line: (0..PLACES).any(|k| bright[k] && opposite(k)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light on 100 DN with a pattern of 2 DN for noise.
    fn about(light: impl Fn(f64, f64) -> f64) -> Surroundings {
        let mut image = CameraImage::new(128, 128, 65535.0);
        for (at, value) in image.values.iter_mut().enumerate() {
            let (x, y) = ((at % 128) as f64 + 0.5, (at / 128) as f64 + 0.5);
            *value = (100.0 + (at * 7919 % 13) as f64 * 0.3 + light(x, y)) as f32;
        }
        let background = Background::estimate(&image, 64);
        surroundings(&image, &background, [64.2, 63.7], 1.3, 0.0)
    }

    #[test]
    fn an_edge_is_told_from_a_star_a_pair_and_a_trail() {
        let star = |x: f64, y: f64| 200.0 * (-((x - 64.2).powi(2) + (y - 63.7).powi(2)) / 3.4).exp();
        assert_eq!(about(star), Surroundings { bright_share: 0.0, line: false });
        // A second star 7.2 px away, on the ring.
        let pair = about(|x, y| star(x, y) + star(x - 7.2, y));
        assert!(pair.bright_share < 0.2 && !pair.line, "{pair:?}");
        let trail = about(|x, _| 200.0 * (-(x - 64.2).powi(2) / 3.4).exp());
        assert!(trail.bright_share < 0.4 && trail.line, "{trail:?}");
        // A step that passes through the spot has half of the ring.
        let edge = about(|x, y| star(x, y) + if x + 0.3 * y > 83.0 { 180.0 } else { 0.0 });
        assert!((0.3..0.7).contains(&edge.bright_share), "{edge:?}");
    }
}
