//! The saturated pixels of a spot: how far they reach, and where their middle is.

use crate::CameraImage;

/// Farthest pixel of a plateau from where it is entered, along each axis: blooming columns are cut there.
const LARGEST_PX: usize = 32;

/// Connected saturated pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plateau {
    /// Their mean place, px.
    pub(crate) centre_px: [f64; 2],
    /// Half of its longer side, px.
    pub(crate) reach_px: f64,
}

/// The saturated pixels that hang together with one within `reach_px` of a place; `None` where there is none.
pub(crate) fn plateau_at(
    image: &CameraImage,
    at_px: [f64; 2],
    reach_px: f64,
    saturation_dn: f32,
) -> Option<Plateau> {
    let [width, height] = [image.width_px as usize, image.height_px as usize];
    let range = |at: f64, size: usize| {
        let end = (at + reach_px).max(0.0) as usize;
        (at - reach_px).max(0.0) as usize..(end + 1).min(size)
    };
    let full = |x: usize, y: usize| image.at(x, y) >= saturation_dn;
    let entry = range(at_px[1], height)
        .flat_map(|y| range(at_px[0], width).map(move |x| [x, y]))
        .find(|&[x, y]| full(x, y))?;
    // A square of marks about the entry holds all that is looked at.
    let side = 2 * LARGEST_PX + 1;
    let mut seen = vec![false; side * side];
    let mut mark = |[x, y]: [usize; 2]| {
        let [column, row] = [x + LARGEST_PX - entry[0], y + LARGEST_PX - entry[1]];
        !std::mem::replace(&mut seen[row * side + column], true)
    };
    mark(entry);
    let mut open = vec![entry];
    let (mut sum, mut count) = ([0usize; 2], 0);
    let (mut least, mut most) = (entry, entry);
    while let Some([x, y]) = open.pop() {
        sum = [sum[0] + x, sum[1] + y];
        count += 1;
        least = [least[0].min(x), least[1].min(y)];
        most = [most[0].max(x), most[1].max(y)];
        for next in [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]] {
            let inside = next[0] < width && next[1] < height;
            let near = inside && (0..2).all(|k| next[k].abs_diff(entry[k]) <= LARGEST_PX);
            if near && full(next[0], next[1]) && mark(next) {
                open.push(next);
            }
        }
    }
    let longer = (most[0] - least[0]).max(most[1] - least[1]) + 1;
    Some(Plateau { centre_px: sum.map(|s| s as f64 / count as f64 + 0.5), reach_px: 0.5 * longer as f64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(full: &[[usize; 2]]) -> CameraImage {
        let mut image = CameraImage { values: vec![10.0; 6400], ..CameraImage::new(80, 80, 4095.0) };
        for [x, y] in full {
            image.values[y * 80 + x] = 4095.0;
        }
        image
    }

    #[test]
    fn only_pixels_that_hang_together_count() {
        // An L of three, and one that touches it at a corner only.
        let image = image(&[[10, 10], [11, 10], [11, 11], [12, 12]]);
        let found = plateau_at(&image, [11.2, 10.1], 1.0, 4000.0).unwrap();
        assert_eq!((found.reach_px, found.centre_px), (1.0, [32.0 / 3.0 + 0.5, 31.0 / 3.0 + 0.5]));
        assert_eq!(plateau_at(&image, [30.0, 30.0], 2.0, 4000.0), None);
    }

    #[test]
    fn a_blooming_column_and_the_images_edges_end_it() {
        let column: Vec<[usize; 2]> = (0..80).map(|y| [0, y]).collect();
        let found = plateau_at(&image(&column), [0.2, 40.0], 1.0, 4000.0).unwrap();
        // Entered at row 39.
        assert_eq!((found.reach_px, found.centre_px), (32.5, [0.5, 39.5]));
    }
}
