//! A solved image's geometry as a FITS header: gnomonic projection with SIP polynomials (Shupe et al. 2005).

use faer::Mat;
use faer::linalg::solvers::SolveLstsq as _;
use glam::{DMat2, DVec2, DVec3};

use retina_files::FitsHeader;

use crate::image::ImageResult;

/// Order of the polynomials: k1 to k3 and decentring within a thousandth of a pixel over fields of 20 deg.
const ORDER: usize = 5;
/// Places along each side of the image through which polynomials are laid.
const PLACES: usize = 33;

/// A FITS file of a header alone, whose world coordinates are those of the image: rows from the top, as `retina` reads
/// FITS. `None` where the image is not solved, or its distortion has no inverse.
pub fn wcs_header(result: &ImageResult) -> Option<Vec<u8>> {
    let solution = result.solution.as_ref().ok()?;
    let pinhole = &result.camera.pinhole;
    let size = DVec2::new(f64::from(pinhole.width_px), f64::from(pinhole.height_px));
    let centre = DVec2::new(pinhole.cx_px, pinhole.cy_px);
    let [ra, dec, _] = solution.ra_dec_roll_rad();
    let inertial_from_camera = solution.camera_from_inertial().inverse();
    let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
    let north = (inertial_from_camera * DVec3::Z).cross(east);
    // On the plane that touches the sky at the boresight: east and north of a pixel.
    let world = |pixel: DVec2| {
        let seen = result.camera.line_of_sight(pixel)?;
        let seen = if solution.mirrored { DVec2::new(-seen.x, seen.y) } else { seen };
        let v = inertial_from_camera * solution.fit.corrected(seen).extend(0.0);
        Some(DVec2::new(v.dot(east), v.dot(north)))
    };
    let slope = |step: DVec2| Some((world(centre + step)? - world(centre - step)?) / 2.0);
    let linear = DMat2::from_cols(slope(DVec2::X)?, slope(DVec2::Y)?);
    let back = linear.inverse();
    let origin = world(centre)?;
    let mut places = Vec::with_capacity(PLACES * PLACES);
    for row in 0..PLACES {
        for column in 0..PLACES {
            let share = DVec2::new(column as f64, row as f64) / (PLACES - 1) as f64;
            let off = share * size - centre;
            // Where the pixel would be without distortion.
            places.push((off, back * (world(centre + off)? - origin)));
        }
    }
    let forward = polynomials(places.iter().map(|(from, to)| (*from, *to - *from)), size.length());
    let inverse = polynomials(places.iter().map(|(from, to)| (*to, *from - *to)), size.length());
    let deg = linear.to_cols_array().map(f64::to_degrees);
    // The tangent point is the boresight; its pixel is where the plane's origin falls.
    let reference = centre - back * origin;
    let mut header = FitsHeader::of_array(8, &[]);
    header
        .integer("WCSAXES", 2)
        .integer("IMAGEW", i64::from(pinhole.width_px))
        .integer("IMAGEH", i64::from(pinhole.height_px))
        .text("CTYPE1", "RA---TAN-SIP")
        .text("CTYPE2", "DEC--TAN-SIP")
        .text("CUNIT1", "deg")
        .text("CUNIT2", "deg")
        .text("RADESYS", "ICRS")
        .real("CRVAL1", ra.to_degrees())
        .real("CRVAL2", dec.to_degrees())
        // FITS counts the centre of the first pixel as 1.
        .real("CRPIX1", reference.x + 0.5)
        .real("CRPIX2", reference.y + 0.5)
        .real("CD1_1", deg[0])
        .real("CD1_2", deg[2])
        .real("CD2_1", deg[1])
        .real("CD2_2", deg[3]);
    for (letters, [x, y]) in [(["A", "B"], forward), (["AP", "BP"], inverse)] {
        for (letter, terms) in letters.into_iter().zip([x, y]) {
            header.integer(&format!("{letter}_ORDER"), ORDER as i64);
            for ((i, j), value) in powers().zip(terms) {
                header.real(&format!("{letter}_{i}_{j}"), value);
            }
        }
    }
    Some(header.bytes())
}

/// Powers of u and v: orders 0 to [`ORDER`].
fn powers() -> impl Iterator<Item = (usize, usize)> {
    (0..=ORDER).flat_map(|sum| (0..=sum).map(move |j| (sum - j, j)))
}

/// Coefficients, in the order of [`powers`], of the polynomials through the changes at places, px; `scale_px` makes powers
/// comparable.
fn polynomials(places: impl Iterator<Item = (DVec2, DVec2)>, scale_px: f64) -> [Vec<f64>; 2] {
    let places: Vec<(DVec2, DVec2)> = places.collect();
    let term = |at: DVec2, (i, j): (usize, usize)| {
        (at.x / scale_px).powi(i as i32) * (at.y / scale_px).powi(j as i32)
    };
    let all: Vec<(usize, usize)> = powers().collect();
    let matrix = Mat::from_fn(places.len(), all.len(), |row, column| term(places[row].0, all[column]));
    let right = Mat::from_fn(places.len(), 2, |row, axis| places[row].1[axis]);
    let found = matrix.qr().solve_lstsq(right);
    [0, 1].map(|axis| {
        all.iter().enumerate().map(|(k, (i, j))| found[(k, axis)] / scale_px.powi((i + j) as i32)).collect()
    })
}
