//! Data that RETINA's libraries carry in themselves.
//!
//! The folder also holds files that the command reads by path (bodies, calibrations, scenarios). Those are not part
//! of this crate. `NOTICE` in the repository names the source of each.

/// Stars of the Hipparcos catalogue to V 8.4, packed; `retina-sky` reads it.
pub const HIPPARCOS: &[u8] = include_bytes!("catalogues/hipparcos.bin");

/// Stock doublets by part number, `optics/doublets.csv`.
pub const DOUBLETS_CSV: &str = include_str!("optics/doublets.csv");

/// Dispersion of the glasses by name, `optics/glasses.csv`.
pub const GLASSES_CSV: &str = include_str!("optics/glasses.csv");

/// Lens systems that ship: name and prescription (`retina.optics/1`).
pub const PRESCRIPTIONS: [(&str, &str); 8] = [
    ("reference-1.0fc-wide", include_str!("optics/reference-1.0fc-wide.toml")),
    ("reference-1.0fc-narrow", include_str!("optics/reference-1.0fc-narrow.toml")),
    ("reference-1.3fc-wide", include_str!("optics/reference-1.3fc-wide.toml")),
    ("reference-1.3fc-narrow", include_str!("optics/reference-1.3fc-narrow.toml")),
    ("reference-1.5fc-wide", include_str!("optics/reference-1.5fc-wide.toml")),
    ("reference-1.5fc-narrow", include_str!("optics/reference-1.5fc-narrow.toml")),
    ("cooke-triplet", include_str!("optics/cooke-triplet.toml")),
    ("double-gauss", include_str!("optics/double-gauss.toml")),
];

/// The paper's wide configuration (25 mm objective), `retina.setup/1`.
pub const WIDE_FOV_SETUP: &str = include_str!("setups/wide-fov.toml");

/// The paper's narrow configuration (50 mm objective), `retina.setup/1`.
pub const NARROW_FOV_SETUP: &str = include_str!("setups/narrow-fov.toml");

/// The setups that ship, by name.
pub const SETUPS: [(&str, &str); 2] = [("wide-fov", WIDE_FOV_SETUP), ("narrow-fov", NARROW_FOV_SETUP)];

/// JSON Schemas (2020-12) of files and documents, by name: those of input files are closed.
pub const SCHEMAS: [(&str, &str); 39] = [
    ("batch", include_str!("schemas/batch.schema.json")),
    ("calibration", include_str!("schemas/calibration.schema.json")),
    ("campaign", include_str!("schemas/campaign.schema.json")),
    ("check", include_str!("schemas/check.schema.json")),
    ("compare", include_str!("schemas/compare.schema.json")),
    ("decision", include_str!("schemas/decision.schema.json")),
    ("diagnosis", include_str!("schemas/diagnosis.schema.json")),
    ("effect", include_str!("schemas/effect.schema.json")),
    ("error", include_str!("schemas/error.schema.json")),
    ("far-range", include_str!("schemas/far-range.schema.json")),
    ("fit", include_str!("schemas/fit.schema.json")),
    ("flashes", include_str!("schemas/flashes.schema.json")),
    ("full-disk", include_str!("schemas/full-disk.schema.json")),
    ("geometry-calibration", include_str!("schemas/geometry-calibration.schema.json")),
    ("investigation", include_str!("schemas/investigation.schema.json")),
    ("lab-align", include_str!("schemas/lab-align.schema.json")),
    ("lab-camera", include_str!("schemas/lab-camera.schema.json")),
    ("lab-capture", include_str!("schemas/lab-capture.schema.json")),
    ("lab-check", include_str!("schemas/lab-check.schema.json")),
    ("lab-devices", include_str!("schemas/lab-devices.schema.json")),
    ("lab-latency", include_str!("schemas/lab-latency.schema.json")),
    ("lab-loop", include_str!("schemas/lab-loop.schema.json")),
    ("lab-loop-summary", include_str!("schemas/lab-loop-summary.schema.json")),
    ("lab-measure", include_str!("schemas/lab-measure.schema.json")),
    ("lab-monitor", include_str!("schemas/lab-monitor.schema.json")),
    ("lab-show", include_str!("schemas/lab-show.schema.json")),
    ("manifest", include_str!("schemas/manifest.schema.json")),
    ("navigation-flashes", include_str!("schemas/navigation-flashes.schema.json")),
    ("navigation-full-disk", include_str!("schemas/navigation-full-disk.schema.json")),
    ("navigation-limb", include_str!("schemas/navigation-limb.schema.json")),
    ("navigation-stars", include_str!("schemas/navigation-stars.schema.json")),
    ("optics-constraints", include_str!("schemas/optics-constraints.schema.json")),
    ("optics-search", include_str!("schemas/optics-search.schema.json")),
    ("radiometry-calibration", include_str!("schemas/radiometry-calibration.schema.json")),
    ("runs", include_str!("schemas/runs.schema.json")),
    ("scene", include_str!("schemas/scene.schema.json")),
    ("setup", include_str!("schemas/setup.schema.json")),
    ("trajectory-summary", include_str!("schemas/trajectory-summary.schema.json")),
    ("truth", include_str!("schemas/truth.schema.json")),
];
