//! Stock doublets: `assets/optics/doublets.csv`.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use retina_files::{InputError, Table, nearest};

use crate::glass::{Glass, GlassCatalogue, Medium};
use crate::surface::{Shape, Surface};

const FILE: &str = "assets/optics/doublets.csv";
const TEXT: &str = retina_assets::DOUBLETS_CSV;

static EMBEDDED: LazyLock<Vec<StockDoublet>> =
    LazyLock::new(|| parse(TEXT).expect("the embedded catalogue is read by a test"));

/// A cemented doublet of a catalogue, in the catalogue's orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct StockDoublet {
    /// Order number.
    pub part: String,
    /// Vendor.
    pub vendor: String,
    /// Radii, mm; infinite for a plane.
    pub radii_mm: [f64; 3],
    /// Centre thicknesses, mm.
    pub thicknesses_mm: [f64; 2],
    /// Glasses.
    pub glasses: [Arc<Glass>; 2],
    /// Diameter of the glass, mm.
    pub diameter_mm: f64,
    /// Focal length at 587.56 nm, mm, as computed for the catalogue.
    pub efl_d_mm: f64,
    /// Back focal length at 587.56 nm, mm.
    pub bfl_d_mm: f64,
    /// Other order numbers with the same prescription.
    pub also: Vec<String>,
}

impl StockDoublet {
    /// Centre thickness of the whole lens, mm.
    pub fn length_mm(&self) -> f64 {
        self.thicknesses_mm[0] + self.thicknesses_mm[1]
    }

    /// Its three surfaces; `reversed`: light meets the third radius first. `gap_mm` follows.
    pub fn surfaces(&self, reversed: bool, gap_mm: f64) -> [Surface; 3] {
        let [r1, r2, r3] = self.radii_mm;
        let [t1, t2] = self.thicknesses_mm;
        let [g1, g2] = &self.glasses;
        let (radii, thicknesses, glasses) =
            if reversed { ([-r3, -r2, -r1], [t2, t1], [g2, g1]) } else { ([r1, r2, r3], [t1, t2], [g1, g2]) };
        let media = [Medium::Glass(glasses[0].clone()), Medium::Glass(glasses[1].clone()), Medium::Air];
        let after = [thicknesses[0], thicknesses[1], gap_mm];
        let mut media = media.into_iter();
        std::array::from_fn(|i| {
            Surface::new(Shape::sphere(radii[i]), after[i], media.next().unwrap_or_default())
                .semi_diameter(self.diameter_mm / 2.0)
                .label(if i == 0 { self.part.clone() } else { String::new() })
        })
    }
}

/// All stock doublets, in the catalogue's order.
pub fn stock_doublets() -> &'static [StockDoublet] {
    &EMBEDDED
}

/// The doublet of this order number, also where it is listed under another one.
///
/// # Errors
/// No such part: the nearest number is suggested. `file` is named.
pub fn stock_doublet(file: &Path, part: &str) -> Result<&'static StockDoublet, InputError> {
    let found = EMBEDDED.iter().find(|lens| lens.part == part || lens.also.iter().any(|other| other == part));
    found.ok_or_else(|| {
        let error = InputError::new(file, "no stock lens has this order number").found(format!("`{part}`"));
        match nearest(part, EMBEDDED.iter().map(|lens| lens.part.as_str())) {
            Some(near) => error.help(format!("did you mean `{near}`?")),
            None => error.help("the stock lenses are listed in assets/optics/doublets.csv"),
        }
    })
}

fn parse(text: &str) -> Result<Vec<StockDoublet>, InputError> {
    let table = Table::parse(Path::new(FILE), text)?;
    let glasses = GlassCatalogue::embedded();
    (0..table.len())
        .map(|row| {
            let number = |column| table.number(row, column);
            let radius = |column| Ok(table.number_or_empty(row, column)?.unwrap_or(f64::INFINITY));
            let glass = |column| glasses.require(Path::new(FILE), table.text(row, column));
            Ok(StockDoublet {
                part: table.text(row, "part").to_owned(),
                vendor: table.text(row, "vendor").to_owned(),
                radii_mm: [radius("radius_1_mm")?, radius("radius_2_mm")?, radius("radius_3_mm")?],
                thicknesses_mm: [number("thickness_1_mm")?, number("thickness_2_mm")?],
                glasses: [glass("glass_1")?, glass("glass_2")?],
                diameter_mm: number("diameter_mm")?,
                efl_d_mm: number("efl_d_mm")?,
                bfl_d_mm: number("bfl_d_mm")?,
                also: table.text(row, "also").split_whitespace().map(str::to_owned).collect(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paraxial::Paraxial;
    use crate::{SystemBuilder, Wavelength};

    /// The file's focal lengths were computed by another program from the same prescriptions, to 1 um.
    #[test]
    fn every_doublet_has_its_catalogued_focal_lengths_both_ways_round() {
        assert_eq!(stock_doublets().len(), 126);
        for lens in stock_doublets() {
            for reversed in [false, true] {
                let system = SystemBuilder::new("t", 5.0)
                    .wavelengths(&[Wavelength { nm: 587.5618, weight: 1.0 }])
                    .lens(lens, reversed)
                    .image_after(10.0)
                    .unwrap();
                let first = Paraxial::primary(&system).unwrap().first_order();
                assert!((first.efl_mm.unwrap() - lens.efl_d_mm).abs() < 2e-3, "{} {first:?}", lens.part);
                if !reversed {
                    assert!((first.bfl_mm.unwrap() - lens.bfl_d_mm).abs() < 2e-3, "{} {first:?}", lens.part);
                }
            }
        }
    }

    #[test]
    fn unknown_part_is_refused_with_the_nearest() {
        let error = stock_doublet(Path::new("a.toml"), "AC508-181-A").unwrap_err();
        assert!(error.help.unwrap().contains("AC508-18"), "nearest part");
        assert_eq!(stock_doublet(Path::new("t"), "67333").unwrap().part, "67330");
    }
}
