//! Corners of boards with the directions that their poses predict, and the files they become.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use retina_calibration::geometry::{CalibrateOptions, calibrate};
use retina_files::{InputError, write_atomic};
use retina_formats::{CalibrationFile, ExtraColumn, PointRow, PointsTable};
use retina_geometry::{Lens, Setup};

/// A camera as another program describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceCamera {
    /// Its model, as the other program calls it.
    pub model: String,
    /// Focal lengths, px.
    pub focal_px: DVec2,
    /// Principal point, px.
    pub centre_px: DVec2,
    /// Image size, px.
    pub size_px: [u32; 2],
    /// The model, where this project has it too.
    pub lens: Option<Lens>,
}

/// A corner of a board in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Where the board's pose puts it, in the camera's frame; the length is its distance in the board's unit.
    pub place_camera: DVec3,
    /// Where the camera saw it, px.
    pub camera_px: DVec2,
    /// Column and row on the board, from 0.
    pub board: [f64; 2],
    /// Standard deviation relative to the others'.
    pub relative_sigma: f64,
}

/// A board in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The image's name.
    pub name: String,
    /// Corners that were found and are no outliers.
    pub corners: Vec<Corner>,
}

/// What a calibration of another program holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Boards {
    /// The file, for errors.
    pub file: PathBuf,
    /// The camera.
    pub camera: SourceCamera,
    /// Its images.
    pub views: Vec<View>,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// What the files to be written cannot take from the source.
#[derive(Debug, Clone, Copy)]
pub struct ImportOptions {
    /// Pixel pitch of the camera, micrometres; it only scales the focal length in `setup.toml`.
    pub pixel_um: f64,
}

/// What was written.
#[derive(Debug, Clone, Default)]
pub struct Imported {
    /// The files.
    pub files: Vec<PathBuf>,
    /// Exposures and rows of `points.csv`.
    pub exposures: usize,
    /// Rows.
    pub rows: usize,
    /// What the user ought to know.
    pub notes: Vec<String>,
}

/// A screen behind a pinhole K_f shows directions up to here from its axis, degrees.
const MOST_DEG: f64 = 88.0;
/// Pixels of the virtual screen, at most.
const MOST_SCREEN_PX: f64 = 16_000.0;
/// Margin about the outermost point, as a share.
const MARGIN: f64 = 0.02;
/// Pixel pitch of the virtual screen, mm: nothing depends on it.
const SCREEN_PITCH_MM: f64 = 0.01;
/// A calibration is written if its polynomials follow the source's lens within this rms, px per axis.
const FOLLOWS_PX: f64 = 0.02;
/// A source's own lens and poses put its corners where they were seen to this part of the image's width: otherwise they
/// are not of these corners.
const MOST_REPROJECTED: f64 = 0.02;
/// Points on each side of the grid over which the polynomials are fitted.
const GRID: u32 = 24;

impl Boards {
    /// Writes `points.csv`, `setup.toml` and, where the lens is known and polynomials can follow it, `calibration.toml`
    /// into a folder, which is made.
    ///
    /// # Errors
    /// No corner can be shown on a screen, or a file cannot be written.
    pub fn write(&self, folder: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
        let mut out = Imported { notes: self.notes.clone(), ..Imported::default() };
        let shown = self.shown(&mut out.notes)?;
        if let Some(lens) = &self.camera.lens {
            out.notes.push(self.reprojected(lens, &shown)?);
        }
        let setup_path = folder.join("setup.toml");
        let text = self.setup_text(&shown, options);
        let setup = Setup::parse(&text, &setup_path)?;
        let table = self.table(&setup, &shown);
        std::fs::create_dir_all(folder).map_err(|e| cannot_write(folder, &e))?;
        write_atomic(&setup_path, text.as_bytes()).map_err(|e| cannot_write(&setup_path, &e))?;
        let points = folder.join("points.csv");
        table.write(&points, &setup)?;
        out.files.extend([setup_path, points]);
        (out.exposures, out.rows) = (table.images.len(), table.rows.len());
        if let Some(lens) = &self.camera.lens {
            let path = folder.join("calibration.toml");
            match self.calibration(lens, &shown, &setup) {
                Ok((file, rms_px)) => {
                    file.write(&path)?;
                    out.notes.push(format!(
                        "calibration.toml holds the lens {} as polynomials, {rms_px:.1e} px rms per axis from it",
                        self.camera.model
                    ));
                    out.files.push(path);
                }
                Err(why) if path.exists() => out.notes.push(format!(
                    "the calibration.toml in the folder is of another import, none is written: {why}"
                )),
                Err(why) => out.notes.push(format!("no calibration.toml is written: {why}")),
            }
        }
        Ok(out)
    }

    /// Lines of sight on the tangent plane of the corners that a screen can show.
    fn shown(&self, notes: &mut Vec<String>) -> Result<Vec<(usize, Corner, DVec2)>, InputError> {
        let all = || self.views.iter().enumerate().flat_map(|(k, v)| v.corners.iter().map(move |c| (k, *c)));
        let most_tan = MOST_DEG.to_radians().tan();
        let within = |c: &Corner| {
            let p = c.place_camera;
            p.is_finite() && p.z > 0.0 && p.x.hypot(p.y) <= most_tan * p.z
        };
        let size = self.camera.size_px.map(f64::from);
        let on_sensor = |c: &Corner| (0..2).all(|k| (0.0..=size[k]).contains(&c.camera_px[k]));
        let beyond = all().filter(|(_, c)| !within(c)).count();
        if beyond > 0 {
            notes.push(format!(
                "{beyond} corners more than {MOST_DEG} deg from the optical axis are left out: K_f is a pinhole, which cannot show them"
            ));
        }
        let beside = all().filter(|(_, c)| within(c) && !on_sensor(c)).count();
        if beside > 0 {
            notes.push(format!("{beside} corners outside the image are left out"));
        }
        let shown: Vec<(usize, Corner, DVec2)> = all()
            .filter(|(_, c)| within(c) && on_sensor(c))
            .map(|(k, c)| (k, c, c.place_camera.truncate() / c.place_camera.z))
            .collect();
        if shown.is_empty() {
            return Err(InputError::new(&self.file, "holds no corner that can be used")
                .found(format!(
                    "{} corners, {beyond} of them beyond {MOST_DEG} deg, {beside} outside the image",
                    all().count()
                ))
                .expected("corners in front of the camera and inside the image")
                .help("look at the image size, and at which poses belong to which images"));
        }
        Ok(shown)
    }

    /// Where the source's own lens and poses put the corners, against where they were seen: what is told of it.
    fn reprojected(&self, lens: &Lens, shown: &[(usize, Corner, DVec2)]) -> Result<String, InputError> {
        let off = |(_, corner, _): &(usize, Corner, DVec2)| {
            lens.pixel(corner.place_camera).map_or(f64::INFINITY, |px| px.distance(corner.camera_px))
        };
        let mut off_px: Vec<f64> = shown.iter().map(off).collect();
        off_px.sort_by(f64::total_cmp);
        let median_px = off_px[off_px.len() / 2];
        let most_px = MOST_REPROJECTED * self.camera.size_px.map(f64::from)[0];
        if median_px.is_nan() || median_px > most_px {
            return Err(InputError::new(&self.file, "its poses do not put its corners where they were seen")
                .found(format!("a median distance of {median_px:.1} px by the lens {}", self.camera.model))
                .expected(format!("at most {most_px:.1} px, {:.0} % of the width", 100.0 * MOST_REPROJECTED))
                .help(
                    "are rotation vectors in radians, translations and board in one unit, and images in their order?",
                ));
        }
        Ok(format!(
            "the source's own lens {} and poses put the corners {median_px:.2} px from where they were seen (median)",
            self.camera.model
        ))
    }

    fn setup_text(&self, shown: &[(usize, Corner, DVec2)], options: &ImportOptions) -> String {
        let most =
            shown.iter().fold(DVec2::splat(1e-3), |most, (_, _, r)| most.max(r.abs())) * (1.0 + MARGIN);
        let focal = 0.5 * (self.camera.focal_px.x + self.camera.focal_px.y);
        let fx_px = focal.min(0.5 * MOST_SCREEN_PX / most.max_element()).max(1.0);
        let side = |half_tan: f64| (2.0 * half_tan * fx_px).ceil().max(1.0);
        let (width, height) = (side(most.x), side(most.y));
        let [camera_width, camera_height] = self.camera.size_px;
        let name = self.file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let plain: String = name
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' })
            .collect();
        let mut out = String::new();
        // Writing into a string cannot fail.
        let _ = write!(
            out,
            "# From a calibration with {}. The screen is virtual: K_f puts onto it the directions that the\n\
             # boards' poses predict. pixel_um and f_number are not in the source; only focal_mm / pixel_um matters.\n\
             schema = \"retina.setup/1\"\nname = \"{plain}\"\n[screen]\nwidth_px = {width}\nheight_px = {height}\n\
             width_mm = {:?}\nheight_mm = {:?}\nbits = 8\n[camera]\nwidth_px = {camera_width}\nheight_px = {camera_height}\n\
             pixel_um = {:?}\nfocal_mm = {:?}\nf_number = 2.8\nbits = 8\n[facility.intrinsics]\nfx_px = {fx_px:?}\n\
             fy_px = {fx_px:?}\ncx_px = {:?}\ncy_px = {:?}\n",
            self.camera.model,
            (width * SCREEN_PITCH_MM).max(0.1),
            (height * SCREEN_PITCH_MM).max(0.1),
            options.pixel_um,
            focal * options.pixel_um * 1e-3,
            0.5 * width,
            0.5 * height,
        );
        out
    }

    fn table(&self, setup: &Setup, shown: &[(usize, Corner, DVec2)]) -> PointsTable {
        let facility = setup.facility_pinhole();
        let mut out = PointsTable::default();
        let mut last = None;
        for (view, corner, line_of_sight) in shown {
            if last != Some(*view) {
                out.images.push(self.views[*view].name.clone());
                last = Some(*view);
            }
            out.rows.push(PointRow::new(
                out.images.len() - 1,
                facility.pixel(*line_of_sight),
                255.0,
                corner.camera_px,
            ));
        }
        let column = |name: &str, value: fn(&Corner) -> f64| ExtraColumn {
            name: name.to_owned(),
            values: shown.iter().map(|(_, corner, _)| value(corner)).collect(),
        };
        out.extra = vec![
            column("board_column", |c| c.board[0]),
            column("board_row", |c| c.board[1]),
            column("board_range", |c| c.place_camera.length()),
        ];
        if shown.iter().any(|(_, c, _)| c.relative_sigma != shown[0].1.relative_sigma) {
            out.extra.push(column("relative_sigma", |c| c.relative_sigma));
        }
        out
    }

    /// The source's lens as D and D^-1, with the polynomials' rms error, px per axis.
    fn calibration(
        &self,
        lens: &Lens,
        shown: &[(usize, Corner, DVec2)],
        setup: &Setup,
    ) -> Result<(CalibrationFile, f64), String> {
        let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
        let (low, high) =
            shown.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), (_, _, r)| {
                (low.min(*r), high.max(*r))
            });
        let size = DVec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
        let mut table = PointsTable { images: vec!["lens".to_owned()], ..PointsTable::default() };
        for (i, j) in (0..GRID).flat_map(|i| (0..GRID).map(move |j| (i, j))) {
            let share = DVec2::new(f64::from(i), f64::from(j)) / f64::from(GRID - 1);
            let r = low + share * (high - low);
            let Ok(px) = lens.pixel(r.extend(1.0)) else { continue };
            if px.cmpge(DVec2::ZERO).all() && px.cmple(size).all() {
                table.rows.push(PointRow::new(0, facility.pixel(r), 255.0, px));
            }
        }
        let options = CalibrateOptions::default();
        let result = calibrate(&table, setup, &options).map_err(|error| {
            // The table is none of a file, so that the error begins without a name.
            format!("its polynomials cannot be fitted: {}", error.to_string().trim_start_matches([':', ' ']))
        })?;
        let focal_arcsec = retina_geometry::ARCSEC_PER_RAD / camera.fx_px;
        let rms_px = result.errors.rms_arcsec / std::f64::consts::SQRT_2 / focal_arcsec;
        if rms_px.is_nan() || rms_px > FOLLOWS_PX {
            return Err(format!(
                "its polynomials follow the lens {} to {rms_px:.2} px only, {FOLLOWS_PX} px are wanted; use --baseline with the lens's model",
                self.camera.model
            ));
        }
        let mut file = CalibrationFile::new(setup);
        file.source = format!("imported lens {}, without measurements", self.camera.model);
        result.store(&mut file);
        file.provenance = Some(CalibrationFile::provenance_of(setup));
        Ok((file, rms_px))
    }
}

/// What the file system said.
pub(crate) fn cannot_write(path: &Path, error: &std::io::Error) -> InputError {
    InputError::new(path, format!("cannot be written: {error}")).help("check the path and the permissions")
}
