//! Whether neighbouring pixels err alike.

use crate::candidates::nine;
use crate::{Background, CameraImage};

/// Places that are looked at, about.
const PLACES: f64 = 1024.0;
/// Fewer tell nothing.
const FEWEST: usize = 200;
/// Share of a normal distribution below one standard deviation.
const ONE_SIGMA: f64 = 0.841_345;
/// Independent noise is found up to here by chance, and where the level's form is finer than the mesh.
const BY_CHANCE: f64 = 1.25;
/// Where the nine pixels err as one.
const MOST: f64 = 3.0;

/// See [`Background::alike`]. Only what is darker than the middle counts: light is no noise.
pub(crate) fn alike(image: &CameraImage, background: &Background) -> f64 {
    let [width, height] = [image.width_px, image.height_px].map(|side| side as usize);
    // An odd step meets every place of the blocks in which images are compressed.
    let step = ((width as f64 * height as f64 / PLACES).sqrt() as usize) | 1;
    let mut darker: Vec<f64> = (1..height.saturating_sub(1))
        .step_by(step)
        .flat_map(|y| (1..width.saturating_sub(1)).step_by(step).map(move |x| [x, y]))
        .map(|[x, y]| {
            let at = [x, y].map(|v| v as f64 + 0.5);
            (9.0 * background.level_dn(at[0], at[1]) - nine(image, x, y))
                / (3.0 * background.noise_dn(at[0], at[1]))
        })
        .collect();
    if darker.len() < FEWEST {
        return 1.0;
    }
    let mut quantile = |share: f64| {
        let at = (share * darker.len() as f64) as usize;
        *darker.select_nth_unstable_by(at, f64::total_cmp).1
    };
    let scatter = quantile(ONE_SIGMA) - quantile(0.5);
    if scatter > BY_CHANCE { scatter.min(MOST) } else { 1.0 }
}
