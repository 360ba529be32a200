//! The embedded glasses: `assets/optics/glasses.csv`.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use retina_files::{InputError, Table};

use super::{Dispersion, Glass, ThermalDispersion};

const FILE: &str = "assets/optics/glasses.csv";
const TEXT: &str = retina_assets::GLASSES_CSV;

static EMBEDDED: LazyLock<Vec<Arc<Glass>>> = LazyLock::new(|| {
    parse(TEXT).expect("the embedded catalogue is read by a test").into_iter().map(Arc::new).collect()
});

pub(super) fn embedded() -> &'static [Arc<Glass>] {
    &EMBEDDED
}

fn numbers(table: &Table, row: usize, column: &str) -> Result<Vec<f64>, InputError> {
    table
        .text(row, column)
        .split_whitespace()
        .map(|text| {
            text.parse().map_err(|_| {
                InputError::new(table.file(), "not a number").cell(table.line(row), column).found(text)
            })
        })
        .collect()
}

fn parse(text: &str) -> Result<Vec<Glass>, InputError> {
    let table = Table::parse(Path::new(FILE), text)?;
    (0..table.len())
        .map(|row| {
            let c = numbers(&table, row, "coefficients")?;
            let dispersion = match table.text(row, "formula") {
                "sellmeier" => Dispersion::sellmeier(
                    &c.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect::<Vec<_>>(),
                ),
                "power" => Dispersion::power_series(
                    c[0],
                    &c[1..].chunks_exact(2).map(|pair| (pair[0], pair[1] as i32)).collect::<Vec<_>>(),
                ),
                other => {
                    return Err(InputError::new(FILE, "unknown formula")
                        .cell(table.line(row), "formula")
                        .found(other)
                        .expected("sellmeier or power"));
                }
            };
            let t = numbers(&table, row, "thermal")?;
            let thermal = (t.len() == 7).then(|| ThermalDispersion {
                d: [t[0], t[1], t[2]],
                e: [t[3], t[4]],
                lambda_tk_um: t[5],
                reference_c: t[6],
            });
            Ok(Glass {
                name: table.text(row, "glass").to_owned(),
                catalogue: table.text(row, "catalogue").to_owned(),
                dispersion,
                range_um: [table.number(row, "min_um")?, table.number(row, "max_um")?],
                thermal,
                expansion_per_k: table.number_or_empty(row, "expansion_1e6_per_k")?.map(|e| e * 1e-6),
            })
        })
        .collect()
}

/// (name, nd, Vd) as the makers print them.
#[cfg(test)]
pub(super) fn printed() -> Vec<(String, f64, f64)> {
    let table = Table::parse(Path::new(FILE), TEXT).unwrap();
    (0..table.len())
        .map(|row| {
            let number = |column| table.number(row, column).unwrap();
            (table.text(row, "glass").to_owned(), number("nd"), number("vd"))
        })
        .collect()
}
