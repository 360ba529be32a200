//! `retina body`.

use std::path::PathBuf;

use retina_files::write_atomic;
use retina_model::{AlbedoSource, BuildSpec, Relief, build_body};
use serde_json::json;

use crate::failure::Failure;
use crate::output::{print_json, tell};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Radius of the reference sphere, m.
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    radius_m: f64,
    /// Relief map: plate carree, grey PNG, TIFF or JPEG, 8 or 16 bits, north up.
    #[arg(long, value_name = "IMAGE")]
    relief: Option<PathBuf>,
    /// Height of one unit of the relief samples, m.
    #[arg(long, requires = "relief", default_value_t = 1.0)]
    metres_per_unit: f64,
    /// Height of a relief sample of 0, m.
    #[arg(long, requires = "relief", default_value_t = 0.0, allow_negative_numbers = true)]
    offset_m: f64,
    /// Albedo map: plate carree, sRGB-encoded PNG, JPEG or TIFF, north up.
    #[arg(long, value_name = "IMAGE")]
    albedo: Option<PathBuf>,
    /// East longitude of the maps' left edge, deg.
    #[arg(long, default_value_t = -180.0, allow_negative_numbers = true)]
    longitude_left_deg: f64,
    /// The same of the relief map, where it differs from the albedo map's.
    #[arg(long, requires = "relief", allow_negative_numbers = true, value_name = "DEG")]
    relief_longitude_left_deg: Option<f64>,
    /// Mesh cells along each edge of a cube face, 1 to 2048.
    #[arg(long, value_name = "N", default_value_t = 256)]
    cells: u32,
    /// Texture pixels along each edge of a cube face, 2 to 8192.
    #[arg(long, value_name = "N", default_value_t = 1024)]
    texels: u32,
    /// Store the textures as JPEG of this quality, 1 to 100 [default: PNG].
    #[arg(long, value_name = "Q")]
    jpeg_quality: Option<u8>,
    /// Name of the body.
    #[arg(long, default_value = "body")]
    name: String,
    /// Source of a map, kept in the model. Repeat the flag for more.
    #[arg(long, value_name = "TEXT")]
    source: Vec<String>,
    /// Text of the model's copyright field.
    #[arg(long, value_name = "TEXT")]
    copyright: Option<String>,
    /// Model to write (.glb).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print the report as a JSON document on standard output.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: Arguments) -> Result<(), Failure> {
    crate::check_file(&arguments.out, "glb")?;
    let longitude_left_deg = arguments.longitude_left_deg;
    let built = build_body(&BuildSpec {
        name: arguments.name,
        radius_m: arguments.radius_m,
        relief: arguments.relief.map(|path| Relief {
            path,
            metres_per_unit: arguments.metres_per_unit,
            offset_m: arguments.offset_m,
            longitude_left_deg: arguments.relief_longitude_left_deg.unwrap_or(longitude_left_deg),
        }),
        albedo: arguments.albedo.map(|path| AlbedoSource { path, longitude_left_deg }),
        cells: arguments.cells,
        texels: arguments.texels,
        jpeg_quality: arguments.jpeg_quality,
        sources: arguments.source,
        copyright: arguments.copyright,
    })?;
    write_atomic(&arguments.out, &built.glb)
        .map_err(|error| Failure::new(format!("{} cannot be written: {error}", arguments.out.display())))?;
    let report = built.report;
    tell!(
        "{}: {} vertices, {} triangles, heights {:.0} to {:.0} m, edges up to {:.4} deg (longest / shortest \
         {:.3}, areas {:.3}), {} bytes",
        arguments.out.display(),
        report.vertices,
        report.triangles,
        report.min_height_m,
        report.max_height_m,
        report.max_edge_rad.to_degrees(),
        report.edge_ratio,
        report.area_ratio,
        report.bytes,
    );
    if report.min_height_m > 0.0 || report.max_height_m < 0.0 {
        tell!(
            "warning: all of the relief lies {} the radius: is a height of --offset-m missing, that of a sample of 0?",
            if report.min_height_m > 0.0 { "above" } else { "below" }
        );
    }
    if arguments.json {
        print_json(&json!({
            "schema": "retina.body/1",
            "out": arguments.out,
            "vertices": report.vertices,
            "triangles": report.triangles,
            "min_height_m": report.min_height_m,
            "max_height_m": report.max_height_m,
            "area_ratio": report.area_ratio,
            "edge_ratio": report.edge_ratio,
            "max_edge_deg": report.max_edge_rad.to_degrees(),
            "bytes": report.bytes,
        }))?;
    }
    Ok(())
}
